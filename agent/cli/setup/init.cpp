#include "agent/cli/subcommands.h"

#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iomanip>
#include <iostream>
#include <iterator>
#include <sstream>
#include <utility>

#include "agent/cli/doctor/guesses.h"
#include "agent/cli/exit_status.h"
#include "agent/cli/setup/init_machine.h"
#include "agent/config/loader.h"
#include "agent/config/source.h"
#include "agent/import/imported.h"
#include "agent/text/text.h"

namespace fxagent {
namespace {

namespace fs = std::filesystem;

/// Returns the flags of the required answers that are missing.
std::string missing(const InitAnswers& answers) {
  std::string flags;
  const auto need = [&](const char* flag, bool is_there) {
    if (!is_there) flags += std::string(flags.empty() ? "" : " ") + flag;
  };
  need("--broker", !answers.broker.empty());
  need("--protocol", !answers.protocol.empty());
  need("--port", !answers.port.empty());
  need("--read", !answers.read.empty() || !answers.write.empty());
  return flags;
}

/// Prompts for an answer. Returns `usual` for an empty line.
std::string ask(const std::string& question, const std::string& usual) {
  std::cerr << question;
  if (!usual.empty()) std::cerr << " [" << usual << "]";
  std::cerr << ": " << std::flush;
  std::string answer;
  std::getline(std::cin, answer);
  const std::string_view text = trimmed(answer);
  return text.empty() ? usual : std::string(text);
}

/// One line of a menu.
struct Choice {
  std::string answer;
  std::string note;
};

/// Shows a menu. Accepts a number, the text of a choice, or any other answer.
std::string choose(const std::string& question, const std::vector<Choice>& choices,
                   const std::string& usual) {
  std::size_t width = 0;
  for (const Choice& choice : choices) width = std::max(width, choice.answer.size());
  for (std::size_t i = 0; i < choices.size(); ++i) {
    const auto& [answer, note] = choices[i];
    std::cerr << std::setw(4) << i + 1 << "  " << answer;
    if (!note.empty()) std::cerr << std::string(width - answer.size() + 2, ' ') << note;
    std::cerr << '\n';
  }
  const std::string answer = ask(question, usual);
  const std::size_t number = number_from<std::size_t>(answer).value_or(0);
  return number >= 1 && number <= choices.size() ? choices[number - 1].answer : answer;
}

/// Prompts without echo.
std::string ask_secret(const std::string& question) {
  termios shown{};
  const bool is_terminal = tcgetattr(STDIN_FILENO, &shown) == 0;
  termios hidden = shown;
  hidden.c_lflag &= ~static_cast<tcflag_t>(ECHO);
  if (is_terminal) tcsetattr(STDIN_FILENO, TCSAFLUSH, &hidden);
  const std::string answer = ask(question, "");
  if (is_terminal) tcsetattr(STDIN_FILENO, TCSAFLUSH, &shown);
  std::cerr << '\n';
  return answer;
}

std::vector<std::string> ask_list(const std::string& question, const std::string& usual) {
  std::istringstream words(ask(question, usual));
  return {std::istream_iterator<std::string>(words), {}};
}

/// Fills in placeholders for answers that are still missing.
InitAnswers filled(InitAnswers answers) {
  if (answers.broker.empty()) answers.broker = "mqtt://127.0.0.1";
  if (answers.protocol.empty()) {
    // Model and addresses are meaningless without a protocol.
    const bool is_serial = LinkTable::is_serial(answers.port).value_or(true);
    answers.protocol = is_serial ? "modbus-rtu" : "modbus-tcp";
    answers.model.clear();
    answers.read.clear();
    answers.write.clear();
  }
  if (answers.port.empty()) answers.port = placeholder_port(answers.protocol);
  const ProtocolInfo* protocol = find_protocol(answers.protocol);
  if (answers.read.empty() && answers.write.empty() && protocol != nullptr)
    answers.read.emplace_back(example_address(*protocol));
  return answers;
}

/// Returns the faults in the answers so far; empty if none.
std::string faults_in(const InitAnswers& answers) {
  const auto files = init_files(filled(answers), "/");
  return files ? std::string() : files.error();
}

/// Repeats until the answer is valid or the input ends. `put` prompts once and stores the answer.
void settle(InitAnswers& answers, const std::function<void(InitAnswers&)>& put) {
  while (std::cin) {
    InitAnswers tried = answers;
    put(tried);
    const std::string faults = faults_in(tried);
    if (faults.empty()) {
      answers = std::move(tried);
      return;
    }
    std::cerr << faults << '\n';
  }
}

void ask_protocol(InitAnswers& answers) {
  std::vector<Choice> choices;
  for (const ProtocolInfo& info : catalog())
    choices.push_back({std::string(info.name), std::string(info.summary)});
  answers.protocol = choose("Protocol, or its number", choices, choices.front().answer);
}

std::string ask_port(const ProtocolInfo& protocol) {
  std::vector<Choice> choices;
  if (protocol.on_serial)
    for (const FoundPort& port : found_serial_ports()) choices.push_back({port.path, port.note});
  const std::string usual =
      choices.empty() ? placeholder_port(protocol.name) : choices.front().answer;
  return choose(choices.empty() ? "Port: a serial one, or host:port"
                                : "Port: a serial one or its number, or host:port",
                choices, usual);
}

/// Returns an empty text if the agent is to read the model from the PLC.
std::string ask_model(const ProtocolInfo& protocol) {
  std::vector<Choice> choices{{std::string(kAutoModel), "the agent asks the PLC"}};
  for (const std::string_view model : protocol.models) choices.push_back({std::string(model), {}});
  const std::string answer = choose("Model, or its number", choices, choices.front().answer);
  return answer == kAutoModel ? std::string() : answer;
}

std::string ask_unit(const ProtocolInfo& protocol, std::string_view key) {
  const Options usual = default_options(protocol);
  const auto* number = std::get_if<std::int64_t>(&usual.find(key)->second);
  return ask(key == "unit" ? "Unit" : "Station number",
             number == nullptr ? std::string() : std::to_string(*number));
}

/// Prompts for the answers that the command line left open.
void ask_for(InitAnswers& answers) {
  settle(answers, [](InitAnswers& a) { a.id = ask("Name of this agent", a.id); });
  if (answers.broker.empty())
    settle(answers, [](InitAnswers& a) { a.broker = ask("Broker", "mqtt://127.0.0.1:1883"); });
  if (answers.user.empty() && answers.password_file.empty())
    settle(answers,
           [](InitAnswers& a) { a.user = ask("User of the agent at the broker (none)", ""); });
  if (answers.protocol.empty()) settle(answers, ask_protocol);
  const ProtocolInfo* protocol = find_protocol(answers.protocol);
  if (protocol == nullptr) return;
  if (answers.port.empty())
    settle(answers, [protocol](InitAnswers& a) { a.port = ask_port(*protocol); });
  if (answers.model.empty() && !protocol->models.empty())
    settle(answers, [protocol](InitAnswers& a) { a.model = ask_model(*protocol); });
  if (const auto key = station_key(*protocol); answers.unit.empty() && !key.empty())
    settle(answers, [protocol, key](InitAnswers& a) { a.unit = ask_unit(*protocol, key); });
  settle(answers, [](InitAnswers& a) { a.device = ask("Name of the device", a.device); });
  if (answers.read.empty())
    settle(answers, [protocol](InitAnswers& a) {
      a.read = ask_list("Addresses to read, separated by spaces",
                        std::string(example_address(*protocol)));
    });
  if (answers.write.empty())
    settle(answers, [](InitAnswers& a) {
      a.write = ask_list("Addresses that may also be written (none)", "");
    });
}

/// True for the config that the package installs, or any other without links and devices.
bool is_of_no_plant(const fs::path& path) {
  const auto text = read_config_file(path.string());
  if (!text) return false;
  const auto config = parse_config(*text);
  return config && config->links.empty() && config->devices.empty();
}

/// Returns why the files cannot be written; empty if they can. `force` allows overwriting.
std::string in_the_way(const fs::path& directory, bool force) {
  std::error_code fault;
  if (fs::exists(directory, fault) && !fs::is_directory(directory, fault))
    return directory.string() + " is not a directory";
  const auto names = init_file_names();
  for (const std::string& name : names) {
    const fs::path path = directory / name;
    if (!fs::exists(path, fault)) continue;
    // Opening a FIFO would block until the other end opens.
    if (!fs::is_regular_file(path, fault))
      return path.string() + " exists and is not a regular file: remove it";
    const bool is_config = name == names.front();
    if (!force && !(is_config && is_of_no_plant(path)))
      return path.string() + " already exists; --force overwrites it";
  }
  return {};
}

/// Writes a file readable by all, whatever the umask: the service runs as another user, and the
/// file contains no secret.
bool write_file(const fs::path& path, const std::string& text) {
  constexpr auto kForAll = static_cast<fs::perms>(0644);
  std::ofstream out(path, std::ios::binary | std::ios::trunc);
  out << text << std::flush;
  std::error_code fault;
  if (out) fs::permissions(path, kForAll, fault);
  return out && !fault;
}

/// Creates the password file. Returns one line about it, or why the file cannot be created.
tl::expected<std::string, std::string> keep_password(const MqttConfig& mqtt, bool may_ask) {
  std::error_code fault;
  std::string password;
  if (may_ask && !fs::exists(mqtt.password_file, fault))
    password = ask_secret("Password of " + mqtt.username + " at the broker (later)");
  const auto file = create_password_file(mqtt.password_file, password, "fxagent");
  if (!file) return tl::unexpected(file.error());
  const std::string whose = "The password of " + mqtt.username + " at the broker ";
  if (!file->is_new) return whose + "is read from " + mqtt.password_file;
  return whose + (password.empty() ? "goes into " : "is in ") + mqtt.password_file +
         " (mode 600, owner " + file->owner + ")";
}

}  // namespace

int run_init(const InitQuestion& question) {
  InitQuestion what = question;
  std::error_code fault;
  fs::path directory = fs::absolute(what.directory, fault).lexically_normal();
  if (!directory.has_filename()) directory = directory.parent_path();  // "." ends with a slash
  if (const std::string why = in_the_way(directory, what.force); !why.empty())
    return refused("init", why, kFailed);
  const bool is_asked = !missing(what.answers).empty();
  if (is_asked) {
    if (::isatty(STDIN_FILENO) == 0)
      return refused("init",
                     "standard input is not a terminal, so init cannot ask; missing options: " +
                         missing(what.answers));
    if (const std::string faults = faults_in(what.answers); !faults.empty())
      return refused("init", faults);
    ask_for(what.answers);
    if (const std::string flags = missing(what.answers); !flags.empty())
      return refused("init", "missing: " + flags);
  }
  const auto files = init_files(what.answers, directory.string());
  if (!files) return refused("init", files.error());
  if (fs::create_directories(directory, fault))
    fs::permissions(directory, static_cast<fs::perms>(0755), fault);
  for (const InitFile& file : *files) {
    if (!write_file(directory / file.name, file.text))
      return refused("init", (directory / file.name).string() + " cannot be written", kFailed);
    std::cout << "wrote " << (directory / file.name).string() << '\n';
  }
  const std::string path = (directory / files->front().name).string();
  const auto config = loaded(path);
  if (!config) return kWrong;
  if (!config->mqtt.password_file.empty()) {
    const auto said = keep_password(config->mqtt, is_asked);
    if (!said) return refused("init", said.error(), kFailed);
    std::cout << *said << '\n';
  }
  std::cout << "\nfxagent check " << path << '\n' << std::flush;
  run_check(path, {});
  std::cout << "\nfxagent plan " << path << '\n';
  run_plan(*config, {});
  std::cout << "\nNext: fxagent check --online " << path << '\n';
  return kDone;
}

}  // namespace fxagent
