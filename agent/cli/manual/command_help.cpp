#include "agent/cli/manual/command_pages.h"

#include <CLI/App.hpp>
#include <array>
#include <string>
#include <string_view>
#include <utility>

namespace fxagent {
namespace {

// Of the program; the subcommands follow.
constexpr std::string_view kProgram = R"(Examples:
  fxagent init /etc/fxagent
  fxagent check --online /etc/fxagent/agent.json
  fxagent read /etc/fxagent/agent.json press1
  fxagent run /etc/fxagent/agent.json
Signals:
  SIGTERM, SIGINT  end; for `run` see fxagent-run(1)
  SIGHUP           for `run`: read the config again
  SIGUSR1          for `run`: switch the traces of all links on or off
  SIGUSR2          for `run`: write a recording of each link)";

constexpr auto kFooters = std::to_array<std::pair<std::string_view, std::string_view>>({
    {"run", R"(Examples:
  fxagent run /etc/fxagent/agent.json
  fxagent run agent.json --trace line1
Signals:
  SIGTERM, SIGINT  stop: pending commands get their results, samples go to disk
  SIGHUP           read the config again; a file with errors changes nothing
  SIGUSR1          switch the traces of all links on or off
  SIGUSR2          write a recording of each link, if the config has a recorder)"},
    {"check", R"(Examples:
  fxagent check agent.json
  fxagent check --online agent.json
  fxagent check --target aws agent.json
Exit status:
  0  the config is valid; with --online, everything answers and matches the config
  1  --online: a link, a device or a broker does not answer; --target: the broker refuses something
  2  the arguments or the config are wrong
  3  --online: another process uses a link, which was not checked; the rest answers
  4  --online: everything answers, and something does not match the config)"},
    {"doctor", R"(Examples:
  fxagent doctor agent.json
  fxagent doctor agent.json --fix fixed.json
Exit status:
  0  everything answers as the config says
  1  a link or a device does not answer, or the copy could not be written
  2  the arguments or the config are wrong
  3  another process uses a link, which was not examined
  4  something does not match the config)"},
    {"scan", R"(Examples:
  fxagent scan /dev/ttyUSB0
Exit status:
  0  something answers
  1  nothing answers, or the port could not be opened
  3  another process uses the port)"},
    {"config", R"(Examples:
  fxagent config agent.json)"},
    {"plan", R"(Examples:
  fxagent plan agent.json
  fxagent plan agent.json --what-if "press1 D0..D99@500")"},
    {"read", R"(Examples:
  fxagent read agent.json press1 D100 --count 3
  fxagent read agent.json press1 temp)"},
    {"write", R"(Examples:
  fxagent write agent.json press1 setpoint 55
  fxagent write agent.json press1 D200 '[1,2,3]' --type uint16)"},
    {"force-on", R"(Examples:
  fxagent force-on agent.json press1 M100)"},
    {"force-off", R"(Examples:
  fxagent force-off agent.json press1 M100)"},
    {"verify-stream", R"(Examples:
  fxagent verify-stream agent.json --seconds 600)"},
    {"record", R"(Examples:
  sudo -u fxagent fxagent record /etc/fxagent/agent.json
  fxagent record agent.json line1
Exit status:
  0  the agent wrote the recordings; their paths are on standard output
  1  no agent answers, or it could not write
  2  the arguments or the config are wrong)"},
    {"replay", R"(Examples:
  fxagent replay 2026-11-26T18-00-00.123456Z-line1.fxrec
  fxagent replay line1.fxrec --pcapng line1.pcapng)"},
    {"acl", R"(Examples:
  fxagent acl agent.json --operator anna --viewer display)"},
    {"describe", R"(Examples:
  fxagent describe agent.json --asyncapi >asyncapi.json
  fxagent describe agent.json --wot >thing.td.json
  fxagent describe agent.json --schema >payloads.schema.json)"},
    {"audit", R"(Examples:
  fxagent audit agent.json --since 2h
  fxagent audit agent.json --verify)"},
    {"import", R"(Examples:
  fxagent import auto comment.csv --device press1 --model FX3U --port /dev/ttyUSB0 >agent.json)"},
    {"export", R"(Examples:
  fxagent export agent.json >tags.csv
  fxagent import csv tags.csv >agent.json)"},
    {"init", R"(Examples:
  fxagent init /etc/fxagent
  fxagent init . --id edge7 --broker mqtt://broker --protocol modbus-tcp --port meter:502 --read power=ir:12)"},
    {"fleet", R"(Examples:
  fxagent fleet status --broker mqtt://broker --root fx/plant-a
  fxagent fleet push configs/{agent}.json --broker mqtt://broker --root fx/plant-a --agents edge1,edge2
Exit status:
  0  every agent is online and has the config it was sent, or accepted it now
  1  not so, or no agent was found
  2  the arguments or a config are wrong, or the broker does not answer)"},
    {"schema", R"(Examples:
  fxagent schema >agent.schema.json)"},
    {"decode", R"(Examples:
  fxagent decode modbus-rtu 11 03 00 6B 00 03 76 87
  fxagent decode fx-programming-port 02 30 31 30 46 36 30 34 03 37 34)"},
});

}  // namespace

void add_footers(CLI::App& app) {
  app.footer(std::string(kProgram));
  for (const auto& [name, text] : kFooters)
    app.get_subcommand(std::string(name))->footer(std::string(text));
}

}  // namespace fxagent
