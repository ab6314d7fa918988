// Command line: run · check · config · plan · read · write · force-on · force-off · audit · decode
// · doctor · scan · record · replay · verify-stream · acl · describe · import · export · init
// · fleet · schema.
// Contains no other logic.
#include <malloc.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <csignal>
#include <exception>
#include <functional>
#include <iostream>
#include <string>
#include <string_view>
#include <vector>

#include "agent/cli/audit/audit.h"
#include "agent/cli/check/check.h"
#include "agent/cli/describe.h"
#include "agent/cli/doctor/doctor.h"
#include "agent/cli/exit_status.h"
#include "agent/cli/fleet/fleet_command.h"
#include "agent/cli/import.h"
#include "agent/cli/manual/command_help.h"
#include "agent/cli/manual/command_pages.h"
#include "agent/cli/manual/schema.h"
#include "agent/cli/one_shot.h"
#include "agent/cli/plan.h"
#include "agent/cli/recording/decode.h"
#include "agent/cli/recording/record.h"
#include "agent/cli/run.h"
#include "agent/cli/setup/acl.h"
#include "agent/cli/setup/init.h"
#include "agent/cli/verify_stream.h"
#include "agent/config/expand.h"
#include "agent/config/json/tree.h"
#include "agent/config/model.h"
#include "agent/config/suggestions.h"
#include "agent/log/log.h"

namespace {

using namespace fxagent;

/// Returns the action of a subcommand that needs a valid config. `path` and `what` outlive it.
template <typename Question>
std::function<int()> with_config(const std::string& path, const Question& what,
                                 int (*run)(const Config&, const Question&)) {
  return [&path, &what, run] {
    const auto config = loaded(path);
    return config ? run(*config, what) : kWrong;
  };
}

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

void add_run(CLI::App& app, RunQuestion& what, std::function<int()>& action) {
  CLI::App* command =
      app.add_subcommand("run", "Poll, publish and carry out commands until SIGTERM");
  command->add_option("CONFIG", what.path, "Config file")->required();
  command->add_option("--log-level", what.log_level, "error, warn, info or debug (info)")
      ->check(CLI::IsMember({"error", "warn", "info", "debug"}))
      ->envname("FXAGENT_LOG_LEVEL");
  command->add_option("--log-format", what.log_format, "text or json (text)")
      ->check(CLI::IsMember({"text", "json"}))
      ->envname("FXAGENT_LOG_FORMAT");
  add_repeatable(command, "--trace", what.traced,
                 "Log every frame of this link and what it means; repeatable");
  command->callback([&] { action = [&] { return run_until_stopped(what); }; });
}

void add_check(CLI::App& app, std::string& path, CheckQuestion& what,
               std::function<int()>& action) {
  CLI::App* command = app.add_subcommand("check", "Check a config file");
  command->add_option("CONFIG", path, "Config file")->required();
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
  command->callback([&] { action = [&] { return run_check(path, what); }; });
}

void add_doctor(CLI::App& app, std::string& path, DoctorQuestion& what,
                std::function<int()>& action) {
  CLI::App* command =
      app.add_subcommand("doctor", "Find out why a device does not answer as the config says");
  command->add_option("CONFIG", path, "Config file")->required();
  command->add_option("--fix", what.fix,
                      "Write a copy of the config with the changes to this new file");
  command->callback([&] {
    action = [&] {
      const auto config = loaded_for_lines(path);
      return config ? run_doctor(*config, path, what) : kWrong;
    };
  });
}

void add_scan(CLI::App& app, std::string& port, std::function<int()>& action) {
  CLI::App* command =
      app.add_subcommand("scan", "Find what answers on a serial port, without a config");
  command->add_option("PORT", port, "/dev/ttyUSB0")->required();
  command->callback([&] { action = [&] { return run_scan(port); }; });
}

void add_config(CLI::App& app, std::string& path, std::function<int()>& action) {
  CLI::App* command = app.add_subcommand("config", "Print a config file in another form");
  command->add_option("CONFIG", path, "Config file")->required();
  command->add_flag("--expand")
      ->description("The default: every device in full, without templates");
  command->callback([&] { action = [&] { return expand(path); }; });
}

void add_plan(CLI::App& app, std::string& path, PlanQuestion& what, std::function<int()>& action) {
  CLI::App* command =
      app.add_subcommand("plan", "Show the reads, their line time and the load of each line");
  command->add_option("CONFIG", path, "Config file")->required();
  command->add_flag("--json", what.as_json, "Print JSON");
  add_repeatable(command, "--what-if", what.what_ifs,
                 "\"DEVICE FIRST..LAST@MS\": the plan before and after these tags");
  command->callback([&] { action = with_config(path, what, run_plan); });
}

int one_shot(const std::string& path, const OneShot& what) {
  log::set_level(log::Level::error);
  std::signal(SIGPIPE, SIG_IGN);
  auto config = loaded_for_lines(path);
  return config ? run_one_shot(std::move(*config), what) : kWrong;
}

/// Adds the subcommand read, write or a force. main() runs `action` after parsing.
void add_one_shot(CLI::App& app, const std::string& name, const std::string& meaning, Op op,
                  std::string& path, OneShot& what, std::function<int()>& action) {
  CLI::App* command = app.add_subcommand(name, meaning);
  command->add_option("CONFIG", path, "Config file")->required();
  command->add_option("DEVICE", what.device, "Device name in the config")->required();
  if (op == Op::read)
    command->add_option("ADDRESS", what.names,
                        "Addresses (D100, Y17, M0 …) or tag names; none: every tag of the device");
  else
    command
        ->add_option_function<std::string>(
            "ADDRESS", [&what](const std::string& address) { what.names = {address}; },
            "Address (D100, Y17, M0 …) or tag name")
        ->required();
  if (op == Op::write)
    command->add_option("VALUE", what.value, "Number, true/false, text or [array]")->required();
  if (op == Op::read)
    command->add_option("--count", what.count, "Devices in a row")->check(CLI::Range(1, 4096));
  if (op == Op::read || op == Op::write) {
    command->add_option("--type", what.type,
                        "bool int16 uint16 int32 uint32 int64 uint64 float32 float64 bcd16 bcd32 "
                        "string");
    command->add_option("--word-order", what.word_order,
                        "ABCD CDAB BADC DCBA low_first high_first, instead of the config's");
  }
  if (op == Op::read)
    command->add_flag("--orders", what.orders,
                      "Show 32- and 64-bit values in every word order, side by side");
  command->add_flag("--json", what.as_json, "Print JSON");
  command->add_flag("--trace", what.trace, "Log every frame of the link and what it means");
  command->callback([&, op] {
    what.op = op;
    action = [&] { return one_shot(path, what); };
  });
}

void add_verify_stream(CLI::App& app, std::string& path, VerifyStream& what,
                       std::function<int()>& action) {
  CLI::App* command =
      app.add_subcommand("verify-stream", "Listen to the agent's samples and list missing ones");
  command->add_option("CONFIG", path, "Config file")->required();
  command
      ->add_option_function<int>(
          "--seconds", [&what](int seconds) { what.listen = std::chrono::seconds(seconds); },
          "How long to listen (60)")
      ->check(CLI::Range(1, 604800));
  command->add_option("--username", what.username, "MQTT user instead of the config's");
  auto* file = command->add_option("--password-file", what.password_file, "File of its password");
  command->add_option("--password-env", what.password_env, "Variable that holds its password")
      ->excludes(file);
  command->add_flag("--json", what.as_json, "Print JSON");
  command->callback([&] { action = with_config(path, what, run_verify_stream); });
}

void add_audit(CLI::App& app, std::string& path, AuditQuestion& what,
               std::function<int()>& action) {
  CLI::App* command = app.add_subcommand("audit", "List every received command with its result");
  command->add_option("CONFIG", path, "Config file")->required();
  command->add_option("--since", what.since,
                      "ms UTC, 2026-11-21, 2026-11-21T08:30 (UTC), or 90s 30m 2h 7d");
  command->add_flag("--json", what.as_json, "Print JSON, one object a command");
  auto* verify =
      command->add_flag("--verify", what.verify, "Check that no record is missing or changed");
  command
      ->add_option("--head", what.head,
                   "RECORDS:HASH of a health message: check that it is in the chain")
      ->needs(verify);
  command->callback([&] { action = with_config(path, what, run_audit); });
}

void add_record(CLI::App& app, std::string& path, RecordQuestion& what,
                std::function<int()>& action) {
  CLI::App* command =
      app.add_subcommand("record", "Ask the running agent to write its newest frames to files");
  command->add_option("CONFIG", path, "Config file")->required();
  command->add_option("LINK", what.links, "Only these links");
  command->callback([&] { action = with_config(path, what, run_record); });
}

void add_replay(CLI::App& app, ReplayQuestion& what, std::function<int()>& action) {
  CLI::App* command = app.add_subcommand("replay", "Explain every frame of a recording");
  command->add_option("FILE", what.path, "Recording of the flight recorder")->required();
  auto* json = command->add_flag("--json", what.as_json, "Print JSON, one object a frame");
  command->add_option("--pcapng", what.pcapng, "Write a capture for Wireshark to this file")
      ->excludes(json);
  command->callback([&] { action = [&] { return run_replay(what); }; });
}

void add_acl(CLI::App& app, std::string& path, AclQuestion& what, std::function<int()>& action) {
  CLI::App* command = app.add_subcommand("acl", "Print an acl_file for the agent's mosquitto");
  command->add_option("CONFIG", path, "Config file")->required();
  command->add_option("--agent", what.agent, "User of the agent (mqtt.username of the config)");
  add_repeatable(command, "--operator", what.operators,
                 "User who reads everything and sends commands; repeatable");
  add_repeatable(command, "--engineer", what.engineers,
                 "User who reads everything and sends configs; repeatable");
  add_repeatable(command, "--viewer", what.viewers, "User who reads everything; repeatable");
  command->callback([&] { action = with_config(path, what, run_acl); });
}

void add_describe(CLI::App& app, DescribeQuestion& what, std::function<int()>& action) {
  CLI::App* command =
      app.add_subcommand("describe", "Describe the topics and payloads for other programs");
  command->add_option("CONFIG", what.path, "Config file; --schema also works without one");
  auto* schema =
      command->add_flag("--schema", what.schema, "Print the JSON Schema of every payload");
  auto* asyncapi = command->add_flag("--asyncapi", what.asyncapi, "Print an AsyncAPI document")
                       ->excludes(schema);
  command->add_flag("--wot", what.wot, "Print a Thing Description of the Web of Things")
      ->excludes(schema)
      ->excludes(asyncapi);
  command->callback([&] { action = [&] { return run_describe(what, FXAGENT_VERSION); }; });
}

void add_schema(CLI::App& app, bool& tables, std::function<int()>& action) {
  CLI::App* command = app.add_subcommand("schema", "Print the JSON Schema of config files");
  command->add_flag("--tables", tables, "Print tables of all keys in Markdown instead");
  command->callback([&] {
    action = [&] {
      std::cout << (tables ? config_tables() : config_schema());
      return 0;
    };
  });
}

void add_import(CLI::App& app, ImportQuestion& what, std::function<int()>& action) {
  CLI::App* command =
      app.add_subcommand("import", "Make a config from another program's tags or device comments");
  command->add_option("FORMAT", what.format, import_format_names())->required();
  command->add_option("FILE", what.path, "The file")->required();
  command->add_option("--device", what.options.device, "Name of the device");
  command->add_option("--protocol", what.options.protocol, "Protocol of the device");
  command->add_option("--model", what.options.model, "Model of the PLC");
  command->add_option("--port", what.options.port, "/dev/ttyUSB0 or host:port");
  command->callback([&] { action = [&] { return run_import(what); }; });
}

void add_export(CLI::App& app, std::string& path, std::function<int()>& action) {
  CLI::App* command = app.add_subcommand("export", "Print the tags of a config for a spreadsheet");
  command->add_option("CONFIG", path, "Config file")->required();
  command->add_flag("--csv")->description(
      "As CSV, the default: `import csv` makes the same config from it");
  command->callback([&] { action = [&] { return loaded(path) ? run_export(path) : kWrong; }; });
}

void add_init(CLI::App& app, InitQuestion& what, std::function<int()>& action) {
  CLI::App* command = app.add_subcommand(
      "init", "Write a config, its broker's access rules, a unit drop-in and a Node-RED flow");
  command->add_option("DIRECTORY", what.directory, "Where to write them (.)");
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
  command->callback([&] { action = [&] { return run_init(what); }; });
}

void add_fleet(CLI::App& app, FleetQuestion& what, std::function<int()>& action) {
  CLI::App* command = app.add_subcommand(
      "fleet", "List all agents of a broker with their configs, or send them configs");
  command->add_option("WHAT", what.what, "status or push")
      ->required()
      ->check(CLI::IsMember({"status", "push"}));
  command->add_option("FILE", what.file,
                      "push: the remote config to send; {agent} in it is the name of each agent");
  command->add_option("--broker", what.broker, "mqtt://host or mqtts://host")->required();
  what.root = "fx";
  command->add_option("--root", what.root, "agent.root of the configs (fx)");
  command->add_option("--mqtt-version", what.mqtt_version, "5 or 3.1.1 (5)")
      ->check(CLI::IsMember({"5", "3.1.1"}));
  command->add_option("--user", what.user, "MQTT user (none)");
  auto* file = command->add_option("--password-file", what.password_file, "File of its password");
  command->add_option("--password-env", what.password_env, "Variable that holds its password")
      ->excludes(file);
  command->add_option("--ca", what.ca_file, "Certificates that sign the broker's");
  command->add_option("--cert", what.cert_file, "Certificate of this user");
  command->add_option("--key", what.key_file, "Its private key");
  auto* agents =
      command->add_option("--agents", what.agents, "Only these: a,b,c; push: in this order")
          ->delimiter(',');
  command->add_flag("--all", what.all, "push: to all agents of the broker")->excludes(agents);
  command->add_option("--batch", what.batch, "push: how many agents at a time (1)")
      ->check(CLI::Range(1, 10000));
  command
      ->add_option_function<int>(
          "--wait-s", [&what](int wait) { what.wait_s = wait; },
          "push: how long a batch may take (30, with --confirmed 120); status: how long nothing "
          "arrives at the end, if this user may not publish (2)")
      ->check(CLI::Range(1, 86400));
  command->add_flag("--confirmed", what.confirmed, "push: wait for the end of each trial");
  command->add_flag("--skip-offline", what.skip_offline, "push: leave out agents that are offline");
  command->add_flag("--dry-run", what.dry_run, "push: check and list, and send nothing");
  command->add_flag("--json", what.as_json, "Print JSON");
  command->callback([&] { action = [&] { return run_fleet(what); }; });
}

void add_decode(CLI::App& app, DecodeQuestion& what, std::function<int()>& action) {
  CLI::App* command = app.add_subcommand("decode", "Explain a frame field by field");
  command->add_option("PROTOCOL", what.protocol, "Protocol name in the config")->required();
  command->add_option("HEX", what.hex, "The frame in hex")->required();
  command->add_option("--model", what.model, "FX model that names the devices");
  auto* request = command->add_flag_callback(
      "--request", [&] { what.direction = Direction::request; }, "The frame is a request");
  command
      ->add_flag_callback(
          "--reply", [&] { what.direction = Direction::reply; }, "The frame is a reply")
      ->excludes(request);
  command->add_flag("--json", what.as_json, "Print JSON");
  command->callback([&] { action = [&] { return run_decode(what); }; });
}

/// Returns an error text if the first argument looks like a subcommand but is unknown; else empty.
std::string misspelt_subcommand(const CLI::App& app, int argc, char** argv) {
  const std::string_view said = argc > 1 ? argv[1] : "";
  if (said.empty() || said.starts_with('-')) return {};
  std::vector<std::string> names;
  for (const CLI::App* command : app.get_subcommands({})) names.push_back(command->get_name());
  if (std::ranges::find(names, said) != names.end()) return {};
  const std::vector<std::string_view> words(names.begin(), names.end());
  return "there is no subcommand " + shown(said) + did_you_mean(said, words);
}

int dispatch(int argc, char** argv) {
  CLI::App app("fxagent: MQTT edge agent for Mitsubishi PLCs and Modbus devices", "fxagent");
  app.set_version_flag("--version", FXAGENT_VERSION);
  app.require_subcommand(1);
  std::function<int()> action;
  std::string path;

  RunQuestion run;
  add_run(app, run, action);

  CheckQuestion check;
  add_check(app, path, check, action);

  DoctorQuestion doctor;
  add_doctor(app, path, doctor, action);
  std::string port;
  add_scan(app, port, action);

  add_config(app, path, action);
  PlanQuestion plan;
  add_plan(app, path, plan, action);

  OneShot what;
  add_one_shot(app, "read", "Read a device", Op::read, path, what, action);
  add_one_shot(app, "write", "Write a device, by the config's rules", Op::write, path, what,
               action);
  add_one_shot(app, "force-on", "Force a bit on", Op::force_on, path, what, action);
  add_one_shot(app, "force-off", "Force a bit off", Op::force_off, path, what, action);

  VerifyStream verify_stream;
  add_verify_stream(app, path, verify_stream, action);

  RecordQuestion record;
  add_record(app, path, record, action);
  ReplayQuestion replay;
  add_replay(app, replay, action);

  AclQuestion acl;
  add_acl(app, path, acl, action);

  DescribeQuestion describe;
  add_describe(app, describe, action);

  bool tables = false;
  add_schema(app, tables, action);

  AuditQuestion audit;
  add_audit(app, path, audit, action);

  ImportQuestion import_question;
  add_import(app, import_question, action);
  add_export(app, path, action);

  InitQuestion init;
  add_init(app, init, action);

  FleetQuestion fleet;
  add_fleet(app, fleet, action);

  DecodeQuestion decode;
  add_decode(app, decode, action);

  // Set before parsing: a missing argument of a subcommand must not prevent --version.
  for (CLI::App* command : app.get_subcommands({}))
    command->set_version_flag("--version", FXAGENT_VERSION);
  add_footers(app);
  if (const auto status = write_command_pages(app, argc, argv, FXAGENT_VERSION)) return *status;
  if (const std::string fault = misspelt_subcommand(app, argc, argv); !fault.empty()) {
    std::cerr << fault << "\nRun with --help for more information.\n";
    return kWrong;
  }
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : kWrong;
  }
  return action();
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
