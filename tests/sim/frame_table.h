// Shared by the protocol tests: tables of frames with the memory before or after them, and
// functions that feed bytes through a framer into a personality.
// Memory is written "D0=1234 ABCD; M5=1": raw hex starting at the device.
#pragma once

#include <algorithm>
#include <chrono>
#include <random>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

#include "tests/sim/personality.h"

namespace fxsim {

enum class Origin { printed, captured, derived };

struct MemoryRun {
  Device device;
  std::vector<std::uint32_t> values;
};

inline std::vector<MemoryRun> memory_runs(std::string_view notation, Family family = Family::fx) {
  std::vector<MemoryRun> runs;
  std::istringstream stream{std::string(notation)};
  for (std::string run; std::getline(stream, run, ';');) {
    const auto equals = run.find('=');
    const auto name = run.find_first_not_of(' ');
    MemoryRun found{parse_device(run.substr(name, equals - name), family).value(), {}};
    std::istringstream values(run.substr(equals + 1));
    for (std::string value; values >> value;)
      found.values.push_back(static_cast<std::uint32_t>(std::stoul(value, nullptr, 16)));
    runs.push_back(found);
  }
  return runs;
}

inline void preset(Plc& plc, std::string_view notation) {
  for (const auto& [device, values] : memory_runs(notation, plc.memory().model().family))
    for (unsigned i = 0; i < values.size(); ++i)
      plc.preset({device.kind, device.number + i}, values[i]);
}

/// Sets every device to the opposite of `notation`, so that an untouched device never looks right.
inline void preset_opposite(Plc& plc, std::string_view notation) {
  for (const auto& [device, values] : memory_runs(notation, plc.memory().model().family))
    for (unsigned i = 0; i < values.size(); ++i)
      plc.preset({device.kind, device.number + i}, ~values[i]);
}

/// Lists the devices whose value differs from `notation`; empty if all match.
inline std::string differences(const Plc& plc, std::string_view notation) {
  std::ostringstream text;
  for (const auto& [device, values] : memory_runs(notation, plc.memory().model().family))
    for (unsigned i = 0; i < values.size(); ++i) {
      const Device one{device.kind, device.number + i};
      if (plc.memory().get(one) != values[i])
        text << device_name(one) << " is " << std::hex << plc.memory().get(one) << "; ";
    }
  return text.str();
}

/// Returns all replies of `personality` to `bytes`. The first byte is complete at `when`, the
/// others follow at 1 ms each. As on a line, frames for other stations are not passed on.
inline Bytes replies_of(const Personality& personality, Framer& framer, Plc& plc, ByteView bytes,
                        TimePoint when = TimePoint{}) {
  std::vector<Frame> frames;
  for (const auto byte : bytes) framer.take(byte, when += std::chrono::milliseconds(1), frames);
  Bytes replies;
  for (const auto& frame : frames) {
    if (frame.whole && !personality.hears(frame)) continue;
    const auto ruling = personality.execute(frame, plc);
    replies.insert(replies.end(), ruling.reply.begin(), ruling.reply.end());
  }
  return replies;
}

inline Bytes replies_of(const Personality& personality, Plc& plc, ByteView bytes) {
  return replies_of(personality, *personality.make_framer(), plc, bytes);
}

/// Returns `frame` with a few bytes changed, inserted and removed, chosen by `random`.
inline Bytes damaged(Bytes frame, std::mt19937& random) {
  const auto below = [&random](std::size_t end) {
    return random() % std::max<std::size_t>(end, 1);
  };
  for (auto times = 1 + below(3); times > 0; --times) {
    const auto at = static_cast<std::ptrdiff_t>(below(frame.size()));
    const auto byte = static_cast<std::uint8_t>(random());
    const auto what = below(3);
    if (what == 0 || frame.empty()) {
      frame.insert(frame.begin() + at, byte);
    } else if (what == 1) {
      frame.erase(frame.begin() + at);
    } else {
      frame[static_cast<std::size_t>(at)] = byte;
    }
  }
  return frame;
}

}  // namespace fxsim
