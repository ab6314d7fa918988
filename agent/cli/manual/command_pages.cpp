#include "agent/cli/manual/command_pages.h"

#include <CLI/App.hpp>
#include <array>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <sstream>
#include <string_view>
#include <utility>
#include <vector>

#include "agent/cli/exit_status.h"
#include "agent/cli/manual/schema.h"
#include "agent/config/suggestions.h"
#include "agent/import/formats.h"
#include "protocol/catalog.h"
#include "protocol/letter_case.h"

namespace fxagent {

std::string roff(std::string_view text) {
  std::string out;
  for (const char c : text) {
    if (c == '\\')
      out += "\\e";
    else if (c == '-')
      out += "\\-";
    else if ((c == '.' || c == '\'') && (out.empty() || out.back() == '\n'))
      out += std::string("\\&") + c;
    else
      out += c;
  }
  return out;
}

namespace {

// ---- what follows the options -------------------------------------------------------------------

// Of the program; the subcommands follow. The heading "Examples:" comes before each.
constexpr std::string_view kProgram = R"(  fxagent init /etc/fxagent
  fxagent check --online /etc/fxagent/agent.json
  fxagent read /etc/fxagent/agent.json press1
  fxagent run /etc/fxagent/agent.json
Signals:
  SIGTERM, SIGINT  end; for `run` see fxagent-run(1)
  SIGHUP           for `run`: read the config again
  SIGUSR1          for `run`: switch the traces of all links on or off
  SIGUSR2          for `run`: write a recording of each link)";

constexpr auto kFooters = std::to_array<std::pair<std::string_view, std::string_view>>({
    {"run", R"(  fxagent run /etc/fxagent/agent.json
  fxagent run agent.json --trace line1
Signals:
  SIGTERM, SIGINT  stop: pending commands get their results, samples go to disk
  SIGHUP           read the config again; a file with errors changes nothing
  SIGUSR1          switch the traces of all links on or off
  SIGUSR2          write a recording of each link, if the config has a recorder)"},
    {"check", R"(  fxagent check agent.json
  fxagent check --online agent.json
  fxagent check --target aws agent.json
Exit status:
  0  the config is valid; with --online, everything answers and matches the config
  1  --online: a link, a device or a broker does not answer; --target: the broker refuses something
  2  the arguments or the config are wrong
  3  --online: another process uses a link, which was not checked; the rest answers
  4  --online: everything answers, and something does not match the config)"},
    {"doctor", R"(  fxagent doctor agent.json
  fxagent doctor agent.json --fix fixed.json
Exit status:
  0  everything answers as the config says
  1  a link or a device does not answer, or the copy could not be written
  2  the arguments or the config are wrong
  3  another process uses a link, which was not examined
  4  something does not match the config)"},
    {"scan", R"(  fxagent scan /dev/ttyUSB0
Exit status:
  0  something answers
  1  nothing answers, or the port could not be opened
  2  the arguments are wrong
  3  another process uses the port)"},
    {"config", "  fxagent config agent.json"},
    {"plan", R"(  fxagent plan agent.json
  fxagent plan agent.json --what-if "press1 D0..D99@500")"},
    {"read", R"(  fxagent read agent.json press1 D100 --count 3
  fxagent read agent.json press1 temp)"},
    {"write", R"(  fxagent write agent.json press1 setpoint 55
  fxagent write agent.json press1 D200 '[1,2,3]' --type uint16)"},
    {"force-on", "  fxagent force-on agent.json press1 M100"},
    {"force-off", "  fxagent force-off agent.json press1 M100"},
    {"verify-stream", "  fxagent verify-stream agent.json --seconds 600"},
    {"record", R"(  sudo -u fxagent fxagent record /etc/fxagent/agent.json
  fxagent record agent.json line1
Exit status:
  0  the agent wrote the recordings; their paths are on standard output
  1  no agent answers, or it could not write
  2  the arguments or the config are wrong)"},
    {"replay", R"(  fxagent replay 2026-11-26T18-00-00.123456Z-line1.fxrec
  fxagent replay line1.fxrec --pcapng line1.pcapng)"},
    {"acl", "  fxagent acl agent.json --operator anna --viewer display"},
    {"describe", R"(  fxagent describe agent.json --asyncapi >asyncapi.json
  fxagent describe agent.json --wot >thing.td.json
  fxagent describe agent.json --schema >payloads.schema.json)"},
    {"audit", R"(  fxagent audit agent.json --since 2h
  fxagent audit agent.json --verify)"},
    {"import",
     "  fxagent import auto comment.csv --device press1 --model FX3U --port /dev/ttyUSB0 "
     ">agent.json"},
    {"export", R"(  fxagent export agent.json >tags.csv
  fxagent import csv tags.csv >agent.json)"},
    {"init", R"(  fxagent init /etc/fxagent
  fxagent init . --id edge7 --broker mqtt://broker --protocol modbus-tcp --port meter:502 --read power=ir:12)"},
    {"fleet", R"(  fxagent fleet status --broker mqtt://broker --root fx/plant-a
  fxagent fleet push configs/{agent}.json --broker mqtt://broker --root fx/plant-a --agents edge1,edge2
Exit status:
  0  status: every agent is online, without a conflict, and has the config that it was sent
     push: every agent has accepted the document; with --skip-offline every agent that is online, and at least one
  1  not so: status and push name the agents; or no agent was found
  2  the arguments or a config are wrong, or the broker does not answer)"},
    {"schema", "  fxagent schema >agent.schema.json"},
    {"decode", R"(  fxagent decode modbus-rtu 11 03 00 6B 00 03 76 87
  fxagent decode fx-programming-port 02 30 31 30 46 36 30 34 03 37 34)"},
});

// ---- man pages ----------------------------------------------------------------------------------

constexpr std::string_view kExitStatus = R"(.SH EXIT STATUS
0: done. 1: the device refused or did not answer, the frame is bad, something is missing, or the agent could not
run. 2: the arguments or the config were wrong.
)";
constexpr std::string_view kFiles = R"(.SH FILES
.TP
.I /etc/fxagent/agent.json
The config of the service.
.TP
.I /var/lib/fxagent
The store of the service: samples and results that wait for the broker, and the audit.
.TP
.I /usr/share/doc/fxagent
How to write a config (docs/config), to run the agent (docs/operate), its topics (docs/interface.md), and examples.
)";

/// Returns the subcommands in the order of their definition.
std::vector<const CLI::App*> subcommands_of(const CLI::App& app) {
  return app.get_subcommands([](const CLI::App* command) { return !command->get_name().empty(); });
}

bool takes_a_value(const CLI::Option& option) { return option.get_items_expected_max() > 0; }

/// Returns all spellings of a named option, the longest last: "-j", "--json".
std::vector<std::string> spellings(const CLI::Option& option) {
  std::vector<std::string> out;
  for (const std::string& name : option.get_snames()) out.push_back("-" + name);
  for (const std::string& name : option.get_lnames()) out.push_back("--" + name);
  return out;
}

/// Returns "INT" for "INT:INT in [1 - 4096]".
std::string value_name(const CLI::Option& option) {
  const std::string type = option.get_type_name();
  return type.substr(0, type.find(':'));
}

std::string range_of(const CLI::Option& option) {
  const std::string type = option.get_type_name();
  const std::size_t colon = type.find(':');
  return colon == std::string::npos ? "" : " (" + type.substr(colon + 1) + ")";
}

std::string entry(const CLI::Option& option) {
  std::string head;
  if (option.nonpositional()) {
    for (const std::string& name : spellings(option))
      head += (head.empty() ? "\\fB" : ", \\fB") + roff(name) + "\\fR";
    if (takes_a_value(option)) head += " \\fI" + roff(value_name(option)) + "\\fR";
  } else {
    head = "\\fI" + roff(option.get_name(true)) + "\\fR";
  }
  return ".TP\n" + head + "\n" + roff(option.get_description() + range_of(option)) + "\n";
}

/// Returns the section of the positional arguments, or of the options.
std::string section(std::string_view title, const CLI::App& command, bool of_options) {
  std::string out;
  for (const CLI::Option* option : command.get_options())
    if (option->nonpositional() == of_options) out += entry(*option);
  return out.empty() ? out : ".SH " + std::string(title) + "\n" + out;
}

std::string synopsis(const CLI::App& app, const CLI::App* subcommand) {
  if (subcommand == nullptr)
    return ".B " + app.get_name() + "\n.I SUBCOMMAND\n[\\fIOPTIONS\\fR] [\\fIARGUMENTS\\fR]\n";
  std::string out =
      ".B " + app.get_name() + " " + roff(subcommand->get_name()) + "\n[\\fIOPTIONS\\fR]\n";
  for (const CLI::Option* option : subcommand->get_options())
    if (!option->nonpositional()) out += ".I " + roff(option->get_name(true)) + "\n";
  return out;
}

/// Returns the sections of a footer. A line that ends in a colon starts a section.
std::string footer(const CLI::App& command) {
  std::istringstream lines(command.get_footer());
  std::string out;
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with(' ') || !line.ends_with(':')) {
      out += roff(line.starts_with("  ") ? line.substr(2) : line) + "\n";
      continue;
    }
    line.pop_back();
    out += (out.empty() ? ".SH " : ".fi\n.SH ") + upper(line) + "\n.nf\n";
  }
  return out.empty() ? out : out + ".fi\n";
}

std::string page_name(const CLI::App& app, const CLI::App& subcommand) {
  return app.get_name() + "-" + subcommand.get_name();
}

std::string see_also(const CLI::App& app, const CLI::App* subcommand) {
  if (subcommand != nullptr) return ".SH SEE ALSO\n.BR " + app.get_name() + " (1)\n";
  std::string out = ".SH SEE ALSO\n.BR " + app.get_name() + ".json (5),\n";
  const auto all = subcommands_of(app);
  for (const CLI::App* command : all)
    out +=
        ".BR " + roff(page_name(app, *command)) + " (1)" + (command == all.back() ? "\n" : ",\n");
  return out;
}

/// Returns the description of a command without the program's name in front.
std::string meaning(const CLI::App& command, const CLI::App& app) {
  const std::string text = command.get_description();
  const std::string before = app.get_name() + ": ";
  return text.starts_with(before) ? text.substr(before.size()) : text;
}

/// Returns the positional arguments: "CONFIG DEVICE ADDRESS".
std::string names_of_places(const CLI::App& command) {
  std::string out;
  for (const CLI::Option* option : command.get_options())
    if (!option->nonpositional()) out += (out.empty() ? "" : " ") + option->get_name(true);
  return out;
}

std::string names_of_options(const CLI::App& command, bool with_value_only) {
  std::string out;
  for (const CLI::Option* option : command.get_options())
    if (option->nonpositional() && (takes_a_value(*option) || !with_value_only))
      for (const std::string& name : spellings(*option)) out += (out.empty() ? "" : " ") + name;
  return out;
}

}  // namespace

void add_footers(CLI::App& app) {
  const auto add = [](CLI::App& to, std::string_view text) {
    to.footer("Examples:\n" + std::string(text));
  };
  add(app, kProgram);
  for (const auto& [name, text] : kFooters) add(*app.get_subcommand(std::string(name)), text);
}

std::string import_format_names() { return "auto " + joined(names_in(import_formats()), " "); }

std::string man_page(const CLI::App& app, const CLI::App* subcommand, const std::string& version) {
  const CLI::App& shown = subcommand == nullptr ? app : *subcommand;
  const std::string name = subcommand == nullptr ? app.get_name() : page_name(app, *subcommand);
  std::string out = ".TH " + roff(upper(name)) + " 1 \"\" \"" +
                    roff(app.get_name() + " " + version) + "\" \"User Commands\"\n.nh\n.SH NAME\n" +
                    roff(name) + " \\- " + roff(meaning(shown, app)) + "\n.SH SYNOPSIS\n" +
                    synopsis(app, subcommand);
  if (subcommand == nullptr) {
    out += ".SH SUBCOMMANDS\n";
    for (const CLI::App* command : subcommands_of(app))
      out += ".TP\n\\fB" + roff(command->get_name()) + "\\fR\n" + roff(command->get_description()) +
             "\n";
  }
  out += section("ARGUMENTS", shown, false) + section("OPTIONS", shown, true) + footer(shown);
  if (out.find(".SH EXIT STATUS\n") == std::string::npos) out += kExitStatus;
  out += kFiles;
  return out + see_also(app, subcommand);
}

std::string bash_completion(const CLI::App& app) {
  std::string names;
  std::string cases;
  for (const CLI::App* command : subcommands_of(app)) {
    names += command->get_name() + " ";
    cases += "    " + command->get_name() + ") words='" + names_of_options(*command, false) +
             "' valued='" + names_of_options(*command, true) + "' places='" +
             names_of_places(*command) + "' ;;\n";
  }
  return "# Completion of " + app.get_name() + ", made by `" + app.get_name() +
         " --help-pages`.\n" +
         R"(_fxagent() {
  local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD-1]} words='' valued='' places=''
)" + "  local protocols='" +
         joined(names_in(catalog()), " ") + "' formats='" + import_format_names() + "'\n" +
         R"(  COMPREPLY=()
  case ${COMP_WORDS[1]} in
)" + cases +
         R"(  esac
  if [ "$COMP_CWORD" -eq 1 ]; then
    words=')" +
         names + names_of_options(app, false) + R"('
  elif [[ " $valued " == *" $before "* ]]; then
    [ "$before" = --protocol ] || return 0
    words=$protocols
  elif [[ $word != -* ]]; then
    # The arguments before this one, without options and their values.
    local given=() i
    for ((i = 2; i < COMP_CWORD; i++)); do
      if [[ " $valued " == *" ${COMP_WORDS[i]} "* ]]; then ((i++)); continue; fi
      [[ ${COMP_WORDS[i]} == -* ]] || given+=("${COMP_WORDS[i]}")
    done
    read -ra places <<<"$places"
    case ${places[${#given[@]}]} in
      PROTOCOL) words=$protocols ;;
      FORMAT) words=$formats ;;
      WHAT) words='status push' ;;
      # Rows of `export`: device, tag, ...
      DEVICE) words=$("${COMP_WORDS[0]}" export "${given[0]}" 2>/dev/null | sed -n '2,${/^#/!s/,.*//p}' | sort -u) ;;
      ADDRESS) words=$("${COMP_WORDS[0]}" export "${given[0]}" 2>/dev/null | sed -n "s/^${given[1]},\([^,]*\),.*/\1/p") ;;
      *) return 0 ;;
    esac
  fi
  mapfile -t COMPREPLY < <(compgen -W "$words" -- "$word")
}
complete -o default -F _fxagent )" +
         app.get_name() + "\n";
}

std::optional<int> write_command_pages(const CLI::App& app, int argc, const char* const* argv,
                                       const std::string& version) {
  if (argc < 2 || std::string_view(argv[1]) != "--help-pages") return std::nullopt;
  if (argc != 3) return refused("", "--help-pages takes the directory to write to");
  const std::filesystem::path directory(argv[2]);
  const auto write = [&](const std::string& name, const std::string& page) {
    std::ofstream file(directory / name);
    if (file << page << std::flush) return true;
    std::cerr << (directory / name).string() << " cannot be written\n";
    return false;
  };
  bool written = write(app.get_name() + ".1", man_page(app, nullptr, version)) &&
                 write(app.get_name() + ".json.5", config_page(version)) &&
                 write(app.get_name() + ".bash", bash_completion(app));
  for (const CLI::App* command : subcommands_of(app))
    written = written && write(page_name(app, *command) + ".1", man_page(app, command, version));
  return written ? kDone : kFailed;
}

}  // namespace fxagent
