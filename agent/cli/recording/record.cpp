#include "agent/cli/subcommands.h"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <fstream>
#include <iostream>
#include <iterator>
#include <string_view>
#include <system_error>
#include <thread>

#include "agent/cli/exit_status.h"
#include "agent/cli/recording/replay_report.h"
#include "agent/config/json/tree.h"
#include "agent/config/suggestions.h"
#include "agent/recorder/recording_files.h"
#include "agent/text/json.h"
#include "protocol/catalog.h"

namespace fxagent {
namespace {

using Clock = std::chrono::steady_clock;

// The agent answers as fast as its disk writes.
constexpr std::chrono::seconds kAnswersWithin{20};
constexpr std::chrono::milliseconds kLookEvery{20};

/// Returns the fault in the links of the question; empty if there is none.
std::string unknown_link(const Config& config, const std::vector<std::string>& wanted) {
  const auto names = names_in(config.links);
  for (const std::string& name : wanted)
    if (std::ranges::find(names, name) == names.end())
      return "there is no link " + shown(name) + in_place_of(name, names);
  return {};
}

/// True if the directory belongs to another user, whose agent would refuse our request.
bool is_of_another(const std::string& directory) {
  struct stat facts {};
  return ::stat(directory.c_str(), &facts) == 0 && facts.st_uid != ::geteuid();
}

void print(const Explanation& frame) {
  std::size_t width = 0;
  for (const auto& [name, meaning] : frame.fields) width = std::max(width, name.size());
  for (const auto& [name, meaning] : frame.fields)
    std::cout << name << std::string(width - name.size() + 2, ' ') << meaning << '\n';
  std::cout << (frame.ok ? "good " : "bad ")
            << (frame.direction == Direction::request ? "request" : "reply") << ": "
            << frame.operation;
  if (frame.device) std::cout << ' ' << *frame.device;
  if (frame.count) std::cout << " × " << *frame.count;
  if (frame.ambiguous) std::cout << " (the other direction is also possible)";
  std::cout << '\n';
  if (frame.error) std::cout << *frame.error << '\n';
}

}  // namespace

int run_record(const Config& config, const std::vector<std::string>& links) {
  if (!config.recorder)
    return refused("",
                   "the config has no flight recorder: add \"recorder\": {\"path\": "
                   "\"/var/lib/fxagent/recordings\"} and restart the agent");
  if (const std::string fault = unknown_link(config, links); !fault.empty())
    return refused("", fault);
  const auto failed = [](const std::string& why) { return refused("", why, kFailed); };
  const std::string& directory = config.recorder->path;
  if (is_of_another(directory))
    return failed(directory +
                  " belongs to another user: run this as the agent's user, as in "
                  "sudo -u fxagent fxagent record");
  const auto agent = writer_of(directory);
  if (!agent)
    return failed(
        "no running agent records to " + directory +
        ": start the agent. If it runs, restart it if recorder.path is new, or see its log");
  if (*agent <= 0)
    return failed("the agent that records to " + directory +
                  " runs in another container: send it SIGUSR2, as in docker kill -s USR2");
  const std::string before = last_answer(directory);
  if (const std::string fault = leave_request(directory, links); !fault.empty())
    return failed(fault);
  if (::kill(*agent, SIGUSR2) != 0)
    return failed("process " + std::to_string(*agent) + ": " +
                  std::generic_category().message(errno) + ": run this as the agent's user");
  const auto give_up = Clock::now() + kAnswersWithin;
  while (Clock::now() < give_up) {
    const std::string answer = last_answer(directory);
    const std::size_t paths = answer.find('\n');
    if (answer != before && paths != answer.npos) {
      std::cout << answer.substr(paths + 1);
      if (paths + 1 < answer.size()) return kDone;
      return failed("the agent wrote no recording: its log says why");
    }
    std::this_thread::sleep_for(kLookEvery);
  }
  return failed("the agent did not answer within " + std::to_string(kAnswersWithin.count()) +
                " s: its disk may hang; see its log");
}

int run_replay(const ReplayQuestion& question) {
  std::ifstream in(question.path, std::ios::binary);
  if (!in)
    return refused(question.path, "cannot be read: " + std::generic_category().message(errno));
  std::string text;
  for (char block[65536]; text.size() <= kMostRecordingBytes && in;) {
    in.read(block, sizeof block);
    text.append(block, static_cast<std::size_t>(in.gcount()));
  }
  auto recording = parse_recording(text);
  if (!recording) return refused(question.path, recording.error());
  const Replay replay(std::move(*recording));
  if (question.pcapng.empty()) {
    std::cout << (question.as_json ? replay_json(replay) : replay_text(replay));
    return kDone;
  }
  const Bytes capture = replay_pcapng(replay);
  std::ofstream out(question.pcapng, std::ios::binary | std::ios::trunc);
  std::copy(capture.begin(), capture.end(), std::ostreambuf_iterator<char>(out));
  out.close();
  if (!out)
    return refused(question.pcapng, "cannot be written: " + std::generic_category().message(errno),
                   kFailed);
  return kDone;
}

int run_decode(const DecodeQuestion& question) {
  const ProtocolInfo* protocol = find_protocol(question.protocol);
  if (protocol == nullptr)
    return refused("", "no protocol " + question.protocol +
                           "; there are: " + joined(names_in(catalog()), " "));
  std::string text;
  for (const std::string& part : question.hex) text += part + ' ';
  const auto frame = from_hex(text);
  if (!frame) return refused("", frame.error().text);
  Options options = default_options(*protocol);
  if (!question.model.empty()) options["model"] = question.model;
  const auto codec = protocol->make(options);
  if (!codec) return refused("", codec.error().text);
  const Explanation explanation = (*codec)->explain(*frame, question.direction);
  if (question.as_json)
    std::cout << dumped(explanation_json(explanation)) << '\n';
  else
    print(explanation);
  return explanation.ok ? kDone : kFailed;
}

}  // namespace fxagent
