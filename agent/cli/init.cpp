#include "agent/cli/init.h"

#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <iostream>
#include <iterator>
#include <sstream>
#include <utility>

#include "agent/config/config.h"
#include "agent/import/imported.h"

namespace fxagent {
namespace {

namespace fs = std::filesystem;

constexpr int kDone = 0;
constexpr int kNotWritten = 1;
constexpr int kWrong = 2;

int wrong(const std::string& text, int status = kWrong) {
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) std::cerr << "init: " << line << '\n';
  return status;
}

/// What must be given and is not, as flags.
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

/// The answer, or `usual` where there is none.
std::string ask(const std::string& question, const std::string& usual) {
  std::cerr << question;
  if (!usual.empty()) std::cerr << " [" << usual << "]";
  std::cerr << ": " << std::flush;
  std::string answer;
  std::getline(std::cin, answer);
  const auto first = answer.find_first_not_of(" \t");
  if (first == answer.npos) return usual;
  return answer.substr(first, answer.find_last_not_of(" \t") - first + 1);
}

std::vector<std::string> ask_list(const std::string& question, const std::string& usual) {
  std::istringstream words(ask(question, usual));
  std::vector<std::string> list;
  for (std::string word; words >> word;) list.push_back(word);
  return list;
}

/// The answers so far, with something in the place of each that is still to come.
InitAnswers filled(InitAnswers answers) {
  if (answers.broker.empty()) answers.broker = "mqtt://127.0.0.1";
  if (answers.protocol.empty()) {
    // Without it neither model nor addresses mean anything.
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

/// What is wrong with the answers so far; empty: nothing.
std::string faults_in(const InitAnswers& answers) {
  const auto files = init_files(filled(answers), "/");
  return files ? std::string() : files.error();
}

/// Asks until the answer is right or the input ends. `put`: asks once, and puts what was said into
/// the answers.
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

/// Asks for what the call leaves open.
void ask_for(InitAnswers& answers) {
  settle(answers, [](InitAnswers& a) { a.id = ask("Name of this agent", a.id); });
  if (answers.broker.empty())
    settle(answers, [](InitAnswers& a) { a.broker = ask("Broker", "mqtt://127.0.0.1:1883"); });
  if (answers.user.empty() && answers.password_file.empty())
    settle(answers,
           [](InitAnswers& a) { a.user = ask("User of the agent at the broker (none)", ""); });
  if (answers.protocol.empty()) {
    for (const ProtocolInfo& info : catalog())
      std::cerr << "  " << info.name << "  " << info.summary << '\n';
    settle(answers, [](InitAnswers& a) {
      a.protocol = ask("Protocol", std::string(catalog().front().name));
    });
  }
  const ProtocolInfo* protocol = find_protocol(answers.protocol);
  if (protocol == nullptr) return;
  if (answers.port.empty())
    settle(answers, [protocol](InitAnswers& a) {
      a.port = ask("Port: a serial one, or host:port",
                   protocol->on_serial ? "/dev/ttyUSB0" : "192.0.2.1:502");
    });
  if (answers.read.empty())
    settle(answers, [protocol](InitAnswers& a) {
      a.read = ask_list("Addresses to read, with blanks between them",
                        std::string(example_address(*protocol)));
    });
  if (answers.write.empty())
    settle(answers, [](InitAnswers& a) {
      a.write = ask_list("Addresses that may be written, too (none)", "");
    });
}

/// The config that the package brings, or one like it: neither links nor devices.
bool is_of_no_plant(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  const auto config = parse_config(text);
  return config && config->links.empty() && config->devices.empty();
}

/// The first of the files that is there; empty: none.
fs::path in_the_way(const fs::path& directory) {
  std::error_code fault;
  const auto names = init_file_names();
  for (const std::string& name : names) {
    const fs::path path = directory / name;
    const bool is_config = name == names.front();
    if (fs::exists(path, fault) && !(is_config && is_of_no_plant(path))) return path;
  }
  return {};
}

/// Whatever the umask: the service reads them as a user of its own, and no secret is in them.
bool write_file(const fs::path& path, const std::string& text) {
  constexpr auto kForAll = static_cast<fs::perms>(0644);
  std::ofstream out(path, std::ios::binary | std::ios::trunc);
  out << text << std::flush;
  std::error_code fault;
  if (out) fs::permissions(path, kForAll, fault);
  return out && !fault;
}

}  // namespace

int run_init(InitQuestion what) {
  std::error_code fault;
  fs::path directory = fs::absolute(what.directory, fault).lexically_normal();
  if (!directory.has_filename()) directory = directory.parent_path();  // "." ends with a slash
  if (const fs::path path = in_the_way(directory); !path.empty() && !what.force)
    return wrong(path.string() + " is there already; --force overwrites", kNotWritten);
  if (!missing(what.answers).empty()) {
    if (::isatty(STDIN_FILENO) == 0)
      return wrong("not on a terminal, so nobody can be asked; missing: " + missing(what.answers));
    if (const std::string faults = faults_in(what.answers); !faults.empty()) return wrong(faults);
    ask_for(what.answers);
    if (const std::string flags = missing(what.answers); !flags.empty())
      return wrong("missing: " + flags);
  }
  const auto files = init_files(what.answers, directory.string());
  if (!files) return wrong(files.error());
  if (fs::create_directories(directory, fault))
    fs::permissions(directory, static_cast<fs::perms>(0755), fault);
  for (const InitFile& file : *files) {
    if (!write_file(directory / file.name, file.text))
      return wrong((directory / file.name).string() + " cannot be written", kNotWritten);
    std::cout << "wrote " << (directory / file.name).string() << '\n';
  }
  const std::string config = (directory / files->front().name).string();
  if (const auto made = load_config(config); made && !made->mqtt.password_file.empty())
    std::cout << "\nThe password of " << made->mqtt.username << " at the broker goes into "
              << made->mqtt.password_file << " (mode 600).\n";
  std::cout << "\nNext: fxagent check " << config << '\n'
            << "      fxagent plan " << config << '\n';
  return kDone;
}

}  // namespace fxagent
