// The subcommands except acl: what each is asked, and how it answers. Each prints its answer on
// stdout and the reason of a refusal on stderr, and returns an exit status.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "agent/cli/setup/init_files.h"
#include "agent/config/config_error.h"
#include "agent/config/model.h"
#include "agent/handover/command_message.h"
#include "agent/import/imported.h"
#include "protocol/codec.h"

namespace fxagent {

// ---- parts of several

/// Prints the errors on stderr, one a line.
void print_errors(const std::vector<ConfigError>& errors, const std::string& path);

/// Calls load_config(). Prints the errors on stderr and returns nullopt if the config is wrong.
std::optional<Config> loaded(const std::string& path, std::string* text = nullptr);
/// The same for a call that uses the lines itself. Prints a note if another gateway may use them.
std::optional<Config> loaded_for_lines(const std::string& path, std::string* text = nullptr);
/// Returns the process of an agent on this machine that runs this config, after a note how to ask
/// it. nullopt: there is none, or this user may not see it.
std::optional<int> note_running_agent(const std::string& path);

// ---- check: validates a config file and checks that this machine can run it

struct CheckQuestion {
  std::string desired;   ///< file with a remote config to check instead; empty: none
  std::string target;    ///< broker to check the config for, as in check_target.h; empty: none
  bool online = false;   ///< open links and broker, and query each device
  bool as_json = false;  ///< output of `online` as JSON
};
/// Opens the links and the brokers of a config and queries each device, with reads alone. Skips a
/// link that another process holds, and every link if an agent on this machine runs this config.
/// Prints its findings and returns exit_status() of online_report.h. `path` is the file.
int run_online_check(const Config& config, const std::string& path, bool as_json);
/// Prints errors and warnings on stderr. Prints one line on stdout if the config is right, and
/// after it what the target refuses or run_online_check() finds. Returns 2 if the config or the
/// target is wrong; 1 if the target refuses something; otherwise 0, or that of run_online_check().
int run_check(const std::string& path, const CheckQuestion& what);

// ---- run: runs the agent until SIGTERM

struct RunQuestion {
  std::string log_level = "info";
  std::string log_format = "text";
  std::vector<std::string> traced;  ///< links by name
};
/// Returns 0 after a stop signal, 1 if the agent could not run, 2 if the config or a traced link is
/// wrong; the reason is in the log. Throws std::runtime_error if the process may not have enough
/// threads or memory. Call before any thread starts. `path` is the file of the config.
int run_until_stopped(const std::string& path, const RunQuestion& what);

// ---- plan: the analysis of plan_report.h as text or JSON

struct PlanQuestion {
  std::vector<std::string> what_ifs;  ///< each "DEVICE FIRST..LAST@MS"
  bool as_json = false;
};
/// Prints the plan; with what-ifs, before and after them. Returns 0, or 2 if a what-if is wrong.
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
/// did not answer; 2 for a wrong argument or config. `path` is the file of the config.
int run_one_shot(const std::string& path, const OneShot& what);

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
/// Prints the tags of a config file. Returns 0, or 2 if the config is wrong.
int run_export(const std::string& path);

// ---- init: creates the initial files of a new plant

struct InitQuestion {
  std::string directory = ".";
  bool force = false;  ///< overwrite existing files
  InitAnswers answers;
};
/// Prompts on a terminal for missing answers, writes the files and creates the password file; then
/// prints check, plan and the next command. Returns 0; 1 if a file exists already or cannot be
/// written; 2 if an answer is wrong, or is missing and stdin is not a terminal.
int run_init(const InitQuestion& question);

// ---- doctor: asks the devices of a config on their lines, and names the config key behind each
// fault; scan: finds what answers on a port without a config. Neither writes to a device

/// Prints a line for each link and device, and for each finding the change of the config. `path` is
/// the file of the config, and `fix` one for a copy with the changes; empty: none. Returns 0 if
/// nothing is found; 1 if a link or device does not answer, or the copy cannot be written; 2 if the
/// config is wrong; 3 if another process uses a link; 4 if something does not match the config.
int run_doctor(const std::string& path, const std::string& fix);
/// Asks on a serial port by each serial protocol. Prints the longest time beforehand, its progress
/// on stderr, and at the end a section for a config. Returns 0 if something answers, 1 if nothing
/// does, 3 if another process uses the port.
int run_scan(const std::string& port);

// ---- record, replay, decode: recordings of the running agent, and the meaning of frames

/// Asks the running agent for recordings of these links, or of all if `links` is empty, and prints
/// the path of each. Returns 1 if no agent answers, 2 if the config has no recorder or no such
/// link.
int run_record(const Config& config, const std::vector<std::string>& links);

struct ReplayQuestion {
  std::string path;
  std::string pcapng;  ///< file to write; empty: print the frames
  bool as_json = false;
};
/// Explains the frames of a recording. Returns 1 if the capture cannot be written, 2 if the file is
/// not a recording.
int run_replay(const ReplayQuestion& question);

struct DecodeQuestion {
  std::string protocol;
  std::vector<std::string> hex;  ///< in any spelling that from_hex() reads
  std::string model;             ///< empty: the protocol's widest model
  std::optional<Direction> direction;
  bool as_json = false;
};
/// Explains a frame field by field. Returns 0 if it is valid, 1 if not, 2 for a wrong argument.
int run_decode(const DecodeQuestion& question);

// ---- audit: lists the commands that an agent has received, read from its store file, and checks
// that the audit records are complete

struct AuditQuestion {
  std::string since;  ///< empty: all records; see audit::since_from()
  std::string head;   ///< for `verify`: "RECORDS:HASH" of a health message; empty: none
  bool verify = false;
  bool as_json = false;
};
/// Works while the agent runs. Returns 0; 1 if `verify` found a fault; 2 if an argument is wrong or
/// there is no audit.
int run_audit(const Config& config, const AuditQuestion& question);

// ---- fleet: reads the retained topics of all agents of a broker, and sends configs to them

struct FleetQuestion {
  std::string what;  ///< status or push
  std::string file;  ///< of push; {agent} stands for the name of each agent
  std::string broker;
  std::string root = "fx";  ///< agent.root of the configs
  std::string mqtt_version = "5";
  MqttConfig mqtt;  ///< user and password
  TlsSettings tls;
  std::vector<std::string> agents;
  bool all = false;
  std::size_t batch = 1;
  /// push: the time of each batch. status: the time without a message that counts as the end, if
  /// the broker does not let this user publish.
  std::optional<int> wait_s;
  bool confirmed = false;
  bool skip_offline = false;
  bool dry_run = false;
  bool as_json = false;
};
/// Returns 0 if each agent is online and has the config that it was sent, or accepted its document
/// (with skip_offline: each agent that is online, and at least one); 1 if not; 2 if the call or a
/// document is wrong, or the broker does not answer.
int run_fleet(const FleetQuestion& what);

}  // namespace fxagent
