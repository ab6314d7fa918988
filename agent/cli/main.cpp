// Command line: the subcommands with their arguments. Contains no other logic.
#include <malloc.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <csignal>
#include <exception>
#include <functional>
#include <iostream>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "agent/cli/exit_status.h"
#include "agent/cli/manual/command_pages.h"
#include "agent/cli/manual/schema.h"
#include "agent/cli/setup/acl.h"
#include "agent/cli/subcommands.h"
#include "agent/config/expand.h"
#include "agent/config/json/tree.h"
#include "agent/config/model.h"
#include "agent/config/suggestions.h"

namespace {

using namespace fxagent;

/// A subcommand and the arguments that it is called with.
template <class Question>
struct Subcommand {
  CLI::App* command;
  Question& what;
};

/// The subcommands. After parsing, `action` runs the one that was called.
struct CommandLine {
  CLI::App app{"fxagent: MQTT edge agent for Mitsubishi PLCs and Modbus devices", "fxagent"};
  std::function<int()> action;
  std::string path;  ///< CONFIG

  CLI::App* add(const std::string& name, const std::string& meaning, std::function<int()> run) {
    CLI::App* command = app.add_subcommand(name, meaning);
    command->callback([this, run = std::move(run)] { action = run; });
    return command;
  }
  template <class Question>
  Subcommand<Question> add(const std::string& name, const std::string& meaning,
                           int (*run)(const Question&)) {
    const auto what = std::make_shared<Question>();
    return {add(name, meaning, [what, run] { return run(*what); }), *what};
  }
  /// Adds a subcommand that takes the path of a config.
  template <class Question>
  Subcommand<Question> add_for_file(const std::string& name, const std::string& meaning,
                                    int (*run)(const std::string&, const Question&)) {
    const auto what = std::make_shared<Question>();
    return {with_path(add(name, meaning, [this, what, run] { return run(path, *what); })), *what};
  }
  /// Adds a subcommand that needs a valid config.
  template <class Question>
  Subcommand<Question> add_for_config(const std::string& name, const std::string& meaning,
                                      int (*run)(const Config&, const Question&)) {
    const auto what = std::make_shared<Question>();
    return {with_path(add(name, meaning,
                          [this, what, run] {
                            const auto config = loaded(path);
                            return config ? run(*config, *what) : kWrong;
                          })),
            *what};
  }
  CLI::App* with_path(CLI::App* command) {
    command->add_option("CONFIG", path, "Config file")->required();
    return command;
  }
};

/// Prints the config with all devices expanded.
int expand(const std::string& path) {
  const auto text = expanded_config(path);
  if (text) {
    std::cout << *text;
    return 0;
  }
  print_errors(text.error(), path);
  return kWrong;
}

/// Ends the process at once. Before the agent runs, nothing needs an orderly end. Without a
/// handler, process 1 of a container would ignore the signal.
void end_at_once(int) { ::_exit(0); }

void end_at_a_stop_signal() {
  std::signal(SIGTERM, end_at_once);
  std::signal(SIGINT, end_at_once);
}

/// Adds an option that may be given several times, each time with one value.
void add_repeatable(CLI::App* command, const std::string& name, std::vector<std::string>& values,
                    const std::string& meaning) {
  command->add_option(name, values, meaning)->expected(1)->take_all();
}

void add_run(CommandLine& line) {
  const auto [command, what] = line.add_for_file(
      "run", "Poll, publish and carry out commands until SIGTERM", run_until_stopped);
  command->add_option("--log-level", what.log_level, "error, warn, info or debug (info)")
      ->check(CLI::IsMember({"error", "warn", "info", "debug"}))
      ->envname("FXAGENT_LOG_LEVEL");
  command->add_option("--log-format", what.log_format, "text or json (text)")
      ->check(CLI::IsMember({"text", "json"}))
      ->envname("FXAGENT_LOG_FORMAT");
  add_repeatable(command, "--trace", what.traced,
                 "Log every frame of this link and what it means; repeatable");
}

void add_check(CommandLine& line) {
  const auto [command, what] = line.add_for_file("check", "Check a config file", run_check);
  auto* desired =
      command->add_option("--desired", what.desired, "Also check the remote config in this file");
  auto* online = command
                     ->add_flag("--online", what.online,
                                "Open each link, connect to the broker, and query each device once")
                     ->excludes(desired);
  command
      ->add_option("--target", what.target,
                   "Also list what this broker refuses: aws, azure, hivemq, nats, rabbitmq")
      ->excludes(desired)
      ->excludes(online);
  command->add_flag("--json", what.as_json, "Print the results of --online as JSON")->needs(online);
}

void add_doctor(CommandLine& line) {
  const auto [command, fix] = line.add_for_file(
      "doctor", "Find out why a device does not answer as the config says", run_doctor);
  command->add_option("--fix", fix, "Write a copy of the config with the changes to this new file");
}

void add_scan(CommandLine& line) {
  const auto [command, port] =
      line.add("scan", "Find what answers on a serial port, without a config", run_scan);
  command->add_option("PORT", port, "/dev/ttyUSB0")->required();
}

void add_config(CommandLine& line) {
  CLI::App* command = line.add("config", "Print a config file in another form",
                               [&line] { return expand(line.path); });
  line.with_path(command)
      ->add_flag("--expand")
      ->description("The default: every device in full, without templates");
}

void add_plan(CommandLine& line) {
  const auto [command, what] = line.add_for_config(
      "plan", "Show the reads, their line time and the load of each line", run_plan);
  command->add_flag("--json", what.as_json, "Print JSON");
  add_repeatable(command, "--what-if", what.what_ifs,
                 "\"DEVICE FIRST..LAST@MS\": the plan before and after these tags");
}

/// Adds the subcommand read, write or a force.
void add_one_shot(CommandLine& line, const std::string& name, const std::string& meaning, Op op) {
  const auto [command, what] = line.add_for_file(name, meaning, run_one_shot);
  what.op = op;
  command->add_option("DEVICE", what.device, "Device name in the config")->required();
  if (op == Op::read)
    command->add_option("ADDRESS", what.names,
                        "Addresses (D100, Y17, M0 …) or tag names; none: every tag of the device");
  else
    command
        ->add_option_function<std::string>(
            "ADDRESS", [&to = what](const std::string& address) { to.names = {address}; },
            "Address (D100, Y17, M0 …) or tag name")
        ->required();
  if (op == Op::write)
    command->add_option("VALUE", what.value, "Number, true/false, text or [array]")->required();
  if (op == Op::read)
    command->add_option("--count", what.count, "Number of consecutive devices")
        ->check(CLI::Range(1, 4096));
  if (op == Op::read || op == Op::write) {
    command->add_option("--type", what.type,
                        "bool int16 uint16 int32 uint32 int64 uint64 float32 float64 bcd16 bcd32 "
                        "string");
    command->add_option("--word-order", what.word_order,
                        "ABCD CDAB BADC DCBA low_first high_first, instead of the config's");
  }
  if (op == Op::read)
    command->add_flag("--orders", what.orders,
                      "Show 32- and 64-bit values in each word order that the device can have");
  command->add_flag("--json", what.as_json, "Print JSON");
  command->add_flag("--trace", what.trace, "Log every frame of the link and what it means");
}

void add_one_shots(CommandLine& line) {
  add_one_shot(line, "read", "Read a device", Op::read);
  add_one_shot(line, "write", "Write a device, by the config's rules", Op::write);
  add_one_shot(line, "force-on", "Force a bit on", Op::force_on);
  add_one_shot(line, "force-off", "Force a bit off", Op::force_off);
}

void add_verify_stream(CommandLine& line) {
  const auto [command, what] = line.add_for_config(
      "verify-stream", "Listen to the agent's samples and list missing ones", run_verify_stream);
  command
      ->add_option_function<int>(
          "--seconds", [&to = what](int seconds) { to.listen = std::chrono::seconds(seconds); },
          "Seconds to listen (60)")
      ->check(CLI::Range(1, 604800));
  command->add_option("--username", what.username, "MQTT user instead of the config's");
  auto* file = command->add_option("--password-file", what.password_file, "File of its password");
  command->add_option("--password-env", what.password_env, "Variable that holds its password")
      ->excludes(file);
  command->add_flag("--json", what.as_json, "Print JSON");
}

void add_audit(CommandLine& line) {
  const auto [command, what] = line.add_for_config(
      "audit", "List every command for a device of the config, with its result", run_audit);
  command->add_option("--since", what.since,
                      "ms UTC, 2026-11-21, 2026-11-21T08:30 (UTC), or 90s 30m 2h 7d");
  command->add_flag("--json", what.as_json, "Print JSON, one object a command");
  auto* verify =
      command->add_flag("--verify", what.verify, "Check that no record is missing or changed");
  command
      ->add_option("--head", what.head,
                   "RECORDS:HASH of a health message: check that it is in the chain")
      ->needs(verify);
}

void add_record(CommandLine& line) {
  const auto [command, links] = line.add_for_config(
      "record", "Ask the running agent to write its newest frames to files", run_record);
  command->add_option("LINK", links, "Only these links");
}

void add_replay(CommandLine& line) {
  const auto [command, what] = line.add("replay", "Explain every frame of a recording", run_replay);
  command->add_option("FILE", what.path, "Recording of the flight recorder")->required();
  auto* json = command->add_flag("--json", what.as_json, "Print JSON, one object a frame");
  command->add_option("--pcapng", what.pcapng, "Write a capture for Wireshark to this file")
      ->excludes(json);
}

void add_acl(CommandLine& line) {
  const auto [command, what] =
      line.add_for_config("acl", "Print an acl_file for the agent's mosquitto", run_acl);
  command->add_option("--agent", what.agent, "User of the agent (mqtt.username of the config)");
  add_repeatable(command, "--operator", what.operators,
                 "User who reads everything and sends commands; repeatable");
  add_repeatable(command, "--engineer", what.engineers,
                 "User who reads everything and sends configs; repeatable");
  add_repeatable(command, "--viewer", what.viewers, "User who reads everything; repeatable");
}

void add_describe(CommandLine& line) {
  const auto [command, what] =
      line.add("describe", "Describe the topics and payloads for other programs", run_describe);
  command->add_option("CONFIG", what.path, "Config file; --schema also works without one");
  auto* schema =
      command->add_flag("--schema", what.schema, "Print the JSON Schema of every payload");
  auto* asyncapi = command->add_flag("--asyncapi", what.asyncapi, "Print an AsyncAPI document")
                       ->excludes(schema);
  command->add_flag("--wot", what.wot, "Print a Thing Description of the Web of Things")
      ->excludes(schema)
      ->excludes(asyncapi);
}

void add_schema(CommandLine& line) {
  const auto tables = std::make_shared<bool>(false);
  line.add("schema", "Print the JSON Schema of config files",
           [tables] {
             std::cout << (*tables ? config_tables() : config_schema());
             return 0;
           })
      ->add_flag("--tables", *tables, "Print tables of all keys in Markdown instead");
}

void add_import(CommandLine& line) {
  const auto [command, what] = line.add(
      "import", "Make a config from another program's tags or device comments", run_import);
  command->add_option("FORMAT", what.format, import_format_names())->required();
  command->add_option("FILE", what.path, "The file")->required();
  command->add_option("--device", what.options.device, "Name of the device");
  command->add_option("--protocol", what.options.protocol, "Protocol of the device");
  command->add_option("--model", what.options.model, "Model of the PLC");
  command->add_option("--port", what.options.port, "/dev/ttyUSB0 or host:port");
}

void add_export(CommandLine& line) {
  CLI::App* command = line.add("export", "Print the tags of a config for a spreadsheet",
                               [&line] { return run_export(line.path); });
  line.with_path(command)->add_flag("--csv")->description(
      "As CSV, the default: `import csv` makes the same config from it");
}

void add_init(CommandLine& line) {
  const auto [command, what] = line.add(
      "init", "Write a config, its broker's access rules, a unit drop-in and a Node-RED flow",
      run_init);
  command->add_option("DIRECTORY", what.directory, "Directory of the files (.)");
  command->add_option("--id", what.answers.id, "Name of this agent (edge1)");
  command->add_option("--broker", what.answers.broker, "mqtt://host or mqtts://host");
  command->add_option("--user", what.answers.user, "User of the agent at the broker (none)");
  command->add_option("--password-file", what.answers.password_file,
                      "File of its password (mqtt_password, next to the config)");
  command->add_option("--operator", what.answers.operator_name,
                      "User of Node-RED, who may send commands (nodered)");
  command->add_option("--protocol", what.answers.protocol, "Protocol of the device");
  command->add_option("--port", what.answers.port, "/dev/ttyUSB0 or host:port");
  command->add_option("--model", what.answers.model, "Model of the PLC (auto)");
  command->add_option("--unit", what.answers.unit, "Unit of Modbus, station of a computer link");
  command->add_option("--device", what.answers.device, "Name of the device (plc1)");
  add_repeatable(command, "--read", what.answers.read,
                 "ADDRESS or NAME=ADDRESS to read; repeatable");
  add_repeatable(command, "--write", what.answers.write,
                 "The same, for addresses that may also be written; repeatable");
  command->add_flag("--force", what.force, "Overwrite existing files");
}

void add_fleet(CommandLine& line) {
  const auto [command, what] = line.add(
      "fleet", "List all agents of a broker with their configs, or send them configs", run_fleet);
  command->add_option("WHAT", what.what, "status or push")
      ->required()
      ->check(CLI::IsMember({"status", "push"}));
  command->add_option("FILE", what.file,
                      "push: the remote config to send; {agent} in it is the name of each agent");
  command->add_option("--broker", what.broker, "mqtt://host or mqtts://host")->required();
  command->add_option("--root", what.root, "agent.root of the configs (fx)");
  command->add_option("--mqtt-version", what.mqtt_version, "5 or 3.1.1 (5)")
      ->check(CLI::IsMember({"5", "3.1.1"}));
  command->add_option("--user", what.mqtt.username, "MQTT user (none)");
  auto* file =
      command->add_option("--password-file", what.mqtt.password_file, "File of its password");
  command->add_option("--password-env", what.mqtt.password_env, "Variable that holds its password")
      ->excludes(file);
  command->add_option("--ca", what.tls.ca_file, "Certificates that sign the broker's");
  command->add_option("--cert", what.tls.cert_file, "Certificate of this user");
  command->add_option("--key", what.tls.key_file, "Its private key");
  auto* agents =
      command->add_option("--agents", what.agents, "Only these: a,b,c; push: in this order")
          ->delimiter(',');
  command->add_flag("--all", what.all, "push: to all agents of the broker")->excludes(agents);
  command->add_option("--batch", what.batch, "push: number of agents at a time (1)")
      ->check(CLI::Range(1, 10000));
  command
      ->add_option_function<int>(
          "--wait-s", [&to = what](int wait) { to.wait_s = wait; },
          "push: seconds that a batch may take (30, with --confirmed 120); status: seconds "
          "without a message before it ends, if this user may not publish (2)")
      ->check(CLI::Range(1, 86400));
  command->add_flag("--confirmed", what.confirmed, "push: wait for the end of each trial");
  command->add_flag("--skip-offline", what.skip_offline, "push: leave out agents that are offline");
  command->add_flag("--dry-run", what.dry_run, "push: check and list, and send nothing");
  command->add_flag("--json", what.as_json, "Print JSON");
}

void add_decode(CommandLine& line) {
  const auto [command, what] = line.add("decode", "Explain a frame field by field", run_decode);
  command->add_option("PROTOCOL", what.protocol, "Protocol name in the config")->required();
  command->add_option("HEX", what.hex, "The frame in hex")->required();
  command->add_option("--model", what.model, "FX model that names the devices");
  auto* request = command->add_flag_callback(
      "--request", [&to = what] { to.direction = Direction::request; }, "The frame is a request");
  command
      ->add_flag_callback(
          "--reply", [&to = what] { to.direction = Direction::reply; }, "The frame is a reply")
      ->excludes(request);
  command->add_flag("--json", what.as_json, "Print JSON");
}

/// Returns an error text if the first argument looks like a subcommand but is unknown; else empty.
std::string misspelt_subcommand(const CLI::App& app, int argc, char** argv) {
  const std::string_view said = argc > 1 ? argv[1] : "";
  if (said.empty() || said.starts_with('-')) return {};
  std::vector<std::string_view> names;
  for (const CLI::App* command : app.get_subcommands({})) names.push_back(command->get_name());
  if (std::ranges::find(names, said) != names.end()) return {};
  return "there is no subcommand " + shown(said) + did_you_mean(said, names);
}

int dispatch(int argc, char** argv) {
  CommandLine line;
  CLI::App& app = line.app;
  app.set_version_flag("--version", FXAGENT_VERSION);
  app.require_subcommand(1);
  for (const auto add :
       {add_run, add_check, add_doctor, add_scan, add_config, add_plan, add_one_shots,
        add_verify_stream, add_record, add_replay, add_acl, add_describe, add_schema, add_audit,
        add_import, add_export, add_init, add_fleet, add_decode})
    add(line);
  // Set before parsing: a missing argument of a subcommand must not prevent --version.
  for (CLI::App* command : app.get_subcommands({}))
    command->set_version_flag("--version", FXAGENT_VERSION);
  add_footers(app);
  if (const auto status = write_command_pages(app, argc, argv, FXAGENT_VERSION)) return *status;
  if (const std::string fault = misspelt_subcommand(app, argc, argv); !fault.empty())
    return refused("", fault + "\nRun with --help for more information.");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : kWrong;
  }
  return line.action();
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1 && std::string_view(argv[1]) == "run") end_at_a_stop_signal();
  // A heap for each Paho thread would waste memory: they allocate a few hundred bytes at a time.
  mallopt(M_ARENA_MAX, 1);
  try {
    return dispatch(argc, argv);
  } catch (const std::exception& error) {
    std::cerr << "fxagent: " << error.what() << '\n';
    return 1;
  }
}
