// The subcommands without a folder of their own: what each is asked, and how it answers. Each
// prints its answer on stdout and the reason of a refusal on stderr, and returns an exit status.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "agent/config/model.h"
#include "agent/handover/command_message.h"
#include "agent/import/imported.h"

namespace fxagent {

// ---- run: runs the agent until SIGTERM

struct RunQuestion {
  std::string path;
  std::string log_level = "info";
  std::string log_format = "text";
  std::vector<std::string> traced;  ///< links by name
};
/// Returns 0 after a stop signal, 1 if the agent could not run, 2 if the config or a traced link is
/// wrong; the reason is in the log. Throws std::runtime_error if the process may not have enough
/// threads or memory. Call before any thread starts.
int run_until_stopped(const RunQuestion& what);

// ---- plan: the analysis of plan_report.h as text or JSON

struct PlanQuestion {
  std::vector<std::string> what_ifs;  ///< each "DEVICE FIRST..LAST@MS"
  bool as_json = false;
};
/// Prints the plan; with what-ifs, the plan before and after them. Returns 0, or 2 if a what-if is
/// wrong.
int run_plan(const Config& config, const PlanQuestion& question);

// ---- read, write, force-on, force-off: one command directly to a device, with the admission and
// bus discipline of the agent but without a broker

struct OneShot {
  Op op = Op::read;
  std::string device;
  /// Addresses or tag names. Op read: empty means all tags. Other ops: exactly one.
  std::vector<std::string> names{};
  std::optional<std::string> value;  ///< op write: a JSON value, or plain text for a string
  std::optional<std::string> type;   ///< a word of DataType
  std::uint16_t count = 0;           ///< op read: number of consecutive devices; 0 means one
  /// Op read and write: overrides the order from config or protocol; a word of ByteOrder.
  std::optional<std::string> word_order{};
  bool orders = false;  ///< op read: show the value in every word order
  bool trace = false;   ///< log every frame of the link
  bool as_json = false;
};
/// Executes the command and prints the outcome. Returns 0 on success; 1 if the device refused or
/// did not answer; 2 for a wrong argument.
int run_one_shot(Config config, const OneShot& what);

// ---- verify-stream: subscribes to the data of the configured agent, and checks that it is
// complete

struct VerifyStream {
  std::chrono::seconds listen{60};
  /// Overrides the config's user and password, for brokers that do not let the agent read its own
  /// data; empty: the config's.
  std::string username;
  std::string password_file;
  std::string password_env;
  bool as_json = false;
};
/// Connects to the first server of the config that answers, under its own client id, and again
/// whenever the connection is lost. Prints its report after `listen`, or sooner on SIGINT or
/// SIGTERM. Returns 0 if nothing is missing; 1 if samples are missing or none arrived; 2 if no
/// broker could be listened to, at the start or at the end; 3 if nothing is known to be missing,
/// but the broker kept no session during an interruption, and samples of that time did not arrive.
int run_verify_stream(const Config& config, const VerifyStream& what);

// ---- describe: the agent's topics and payloads for other programs

struct DescribeQuestion {
  std::string path;       ///< config file; empty: any agent, with `schema` only
  bool schema = false;    ///< JSON Schema of every payload
  bool asyncapi = false;  ///< AsyncAPI document
  bool wot = false;       ///< W3C Thing Description
};
/// Prints the document; exactly one of the three must be set. Returns 0, or 2 for a wrong argument.
int run_describe(const DescribeQuestion& what);

// ---- import, export: convert files of other programs to configs, and the tags of a config to CSV
// and back

struct ImportQuestion {
  std::string format;  ///< a name from import_formats(), or auto
  std::string path;
  ImportOptions options;
};
/// Prints a config that passes `check`, and on stderr everything in the file that it leaves out.
/// Returns 0; 1 if nothing could be converted; 2 if an argument is wrong or the file cannot be
/// read.
int run_import(const ImportQuestion& what);
/// Prints the tags of a config file that has passed `check`. Returns 0, or 2 if the file can no
/// longer be read.
int run_export(const std::string& path);

}  // namespace fxagent
