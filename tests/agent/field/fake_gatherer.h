// A device for the made-up protocol of GatheringCodec: words that count up, with holes, limits and
// temporary refusals chosen by the test.
#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "protocol/value/bytes.h"
#include "tests/protocol/gathering_codec.h"

namespace fxagent::test {

class FakeGatherer final {
 public:
  std::map<unsigned, unsigned> words;  ///< W5 as 5; V5 as 10005
  std::set<unsigned> lacks;            ///< same numbering
  std::set<unsigned> not_gathered;     ///< refused only within a Gather
  std::set<unsigned> unknown_commands;
  std::set<unsigned> dropped_commands;  ///< never answered
  std::set<unsigned> garbled_commands;  ///< answered with nonsense
  std::size_t most_parts = 1000;
  int in_a_mood = 0;  ///< number of answers that will be `mood`
  int mood = 0;
  bool silent = false;
  std::vector<std::string> asked;  ///< "W10+60" for a single read, "1: W5 W900+2" for a command

  Bytes answer(ByteView frame) {
    Bytes image;
    std::string text;
    bool whole = true;
    const unsigned command = number(frame, 2 + 8);
    for (std::size_t at = 2; at + 10 <= frame.size(); at += 10) {
      const unsigned first = number(frame, at) * 10000 + number(frame, at + 2) / 16;
      const unsigned count = number(frame, at + 4) / 16;
      text += (text.empty() ? "" : " ") + std::string(first < 10000 ? "W" : "V") +
              std::to_string(first % 10000) + (count == 1 ? "" : "+" + std::to_string(count));
      for (unsigned n = first; n < first + count; ++n) {
        whole = whole && !lacks.contains(n) && !(command != 0 && not_gathered.contains(n));
        const auto known = words.find(n);
        const unsigned value = known == words.end() ? n : known->second;
        image.push_back(static_cast<std::uint8_t>(value));
        image.push_back(static_cast<std::uint8_t>(value >> 8));
      }
    }
    asked.push_back((command == 0 ? "" : std::to_string(command) + ": ") + text);
    if (silent || dropped_commands.contains(command)) return {};
    if (garbled_commands.contains(command))
      return {static_cast<std::uint8_t>(frame[0] + 100U), 'D', 0};
    const auto no = [&](int code) { return Bytes{frame[0], 'N', static_cast<std::uint8_t>(code)}; };
    if (in_a_mood > 0) {
      --in_a_mood;
      return no(mood);
    }
    if (unknown_commands.contains(command)) return no(GatheringCodec::kUnknownCommand);
    const std::size_t parts = (frame.size() - 2) / 10;
    if (!whole || (command != 0 && parts > most_parts)) return no(GatheringCodec::kHole);
    Bytes reply{frame[0], 'D', static_cast<std::uint8_t>(image.size())};
    reply.insert(reply.end(), image.begin(), image.end());
    return reply;
  }

 private:
  static unsigned number(ByteView frame, std::size_t at) {
    return frame.size() < at + 2 ? 0U : frame[at] + frame[at + 1] * 256U;
  }
};

}  // namespace fxagent::test
