#include "agent/cli/recording/record.h"

#include <algorithm>
#include <iostream>
#include <nlohmann/json.hpp>

#include "agent/cli/exit_status.h"
#include "agent/cli/recording/replay_report.h"
#include "agent/config/suggestions.h"
#include "agent/text/json.h"
#include "protocol/catalog.h"

namespace fxagent {
namespace {

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

int run_decode(const DecodeQuestion& question) {
  const ProtocolInfo* protocol = find_protocol(question.protocol);
  if (protocol == nullptr) {
    std::cerr << "no protocol " << question.protocol
              << "; there are: " << joined(names_in(catalog()), " ") << '\n';
    return kWrong;
  }
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
