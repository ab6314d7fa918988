// Shared by the protocol tests: the exchanges of tests/frames with the memory before and after
// them, and functions that feed bytes through a framer into a personality. Memory is written
// "D0=1234 ABCD; M5=1": raw hex starting at the device.
//
// An exchange says in a line "@ [words] [memory before] [-> memory after]" how the simulator takes
// part. Words: the models on which it is tried (without any: its own), and
//   -        not simulated
//   stopped  the PLC is in STOP
//   made     the memory is as the PLC is made, not as the exchange's image says
//   refusal  the reply is the refusal with the image's code, whatever the request
// Without a memory in this line, a read's image is the memory before, and a write's the one after.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <random>

#include "tests/sim/personality.h"
#include "tests/support/transcripts.h"

namespace fxsim {

namespace test = fxagent::test;

struct MemoryRun {
  Device device;
  std::vector<std::uint32_t> values;
};
using Memory = std::vector<MemoryRun>;

inline std::vector<std::string> split(std::string_view text, char separator) {
  std::vector<std::string> parts;
  std::istringstream stream{std::string(text)};
  for (std::string part; std::getline(stream, part, separator);) parts.push_back(part);
  return parts;
}

inline Memory memory_runs(std::string_view notation, Family family = Family::fx) {
  Memory runs;
  for (const auto& run : split(notation, ';')) {
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

inline void preset(Plc& plc, const Memory& memory, std::uint32_t changed_bits = 0) {
  for (const auto& [device, values] : memory)
    for (unsigned i = 0; i < values.size(); ++i)
      plc.preset({device.kind, device.number + i}, values[i] ^ changed_bits);
}

inline void preset(Plc& plc, std::string_view notation) {
  preset(plc, memory_runs(notation, plc.memory().model().family));
}

/// Lists the devices whose value differs from `memory`; empty if all match.
inline std::string differences(const Plc& plc, const Memory& memory) {
  std::ostringstream text;
  for (const auto& [device, values] : memory)
    for (unsigned i = 0; i < values.size(); ++i) {
      const Device one{device.kind, device.number + i};
      if (plc.memory().get(one) != values[i])
        text << device_name(one) << " is " << std::hex << plc.memory().get(one) << "; ";
    }
  return text.str();
}

inline std::string differences(const Plc& plc, std::string_view notation) {
  return differences(plc, memory_runs(notation, plc.memory().model().family));
}

// ENQ, STX, ETX, ACK, NAK, EOT, CR and LF are written as < > | + - . r n.
inline constexpr std::string_view kMarks = "<>|+-.rn";
inline constexpr std::string_view kMarked = "\x05\x02\x03\x06\x15\x04\r\n";

/// Converts text with marks to the bytes of a frame.
inline Bytes from_marks(std::string_view text) {
  Bytes bytes;
  for (const char c : text) {
    const auto mark = kMarks.find(c);
    bytes.push_back(static_cast<std::uint8_t>(mark == std::string_view::npos ? c : kMarked[mark]));
  }
  return bytes;
}

/// The inverse of from_marks().
inline std::string with_marks(ByteView bytes) {
  std::string text(as_text(bytes));
  for (auto& c : text)
    if (const auto mark = kMarked.find(c); mark != std::string_view::npos) c = kMarks[mark];
  return text;
}

/// `count` bytes 00 in hex, each after a blank.
inline std::string zeros(unsigned count) {
  std::string text;
  for (unsigned i = 0; i < count; ++i) text += " 00";
  return text;
}

/// Returns the frames that `bytes` complete. The first byte is complete at `when`, the others
/// follow at 1 ms each.
inline std::vector<Frame> frames_of(Framer& framer, ByteView bytes, TimePoint when = TimePoint{}) {
  std::vector<Frame> frames;
  for (const auto byte : bytes) framer.take(byte, when += std::chrono::milliseconds(1), frames);
  return frames;
}

/// Returns all replies of `personality` to `bytes`, which arrive as in frames_of(). As on a line,
/// frames for other stations are not passed on.
inline Bytes replies_of(const Personality& personality, Framer& framer, Plc& plc, ByteView bytes,
                        TimePoint when = TimePoint{}) {
  Bytes replies;
  for (const auto& frame : frames_of(framer, bytes, when)) {
    if (frame.whole && !personality.hears(frame)) continue;
    const auto ruling = personality.execute(frame, plc);
    replies.insert(replies.end(), ruling.reply.begin(), ruling.reply.end());
  }
  return replies;
}

inline Bytes replies_of(const Personality& personality, Plc& plc, ByteView bytes) {
  return replies_of(personality, *personality.make_framer(), plc, bytes);
}

/// Returns the memory that an exchange's image is of. On the programming port an image of bits
/// begins at a multiple of eight: `whole_bytes`.
inline Memory memory_of(const test::Exchange& e, Family family, bool whole_bytes) {
  Memory memory;
  const auto items = split(e.device, ',');
  std::size_t at = 0;
  for (const auto& item : items) {
    const auto star = item.find('*');  // "D1500*2": two words
    MemoryRun run{parse_device(item.substr(0, star), family).value(), {}};
    const std::size_t size = star == std::string::npos ? e.image.size() / items.size()
                                                       : 2 * std::stoul(item.substr(star + 1));
    const auto image = ByteView(e.image).subspan(at, size);
    const std::size_t points = items.size() == 1 ? e.bytes : 1;
    const auto bytes = width(run.device.kind) / 8;
    if (e.operation.find("force_") != std::string::npos) {
      run.values = {e.operation.ends_with("on") ? 1U : 0U};
    } else if (bytes == 0) {
      if (whole_bytes) run.device.number -= run.device.number % 8;
      const auto bits = whole_bytes || size >= 2 * points ? 8 * size : points;
      for (std::size_t i = 0; i < bits; ++i)
        run.values.push_back(static_cast<unsigned>(image[i / 8]) >> i % 8 & 1U);
    } else {
      for (std::size_t i = 0; i < size; i += bytes) {
        std::uint32_t value = 0;
        for (std::size_t byte = bytes; byte > 0; --byte) value = value << 8U | image[i + byte - 1];
        run.values.push_back(value);
      }
    }
    at += size;
    memory.push_back(run);
  }
  return memory;
}

/// How the simulator takes part in an exchange.
struct Part {
  std::vector<std::string> models;
  bool stopped = false;
  bool made = false;
  std::string before{};
  std::string after{};
};

inline Part part_in(const test::Exchange& e) {
  Part part;
  const auto arrow = e.simulated.find("->");
  if (arrow != std::string::npos) part.after = e.simulated.substr(arrow + 2);
  for (const auto& word : split(e.simulated.substr(0, arrow), ' ')) {
    if (!part.before.empty() || word.find('=') != std::string::npos)
      part.before += word + " ";
    else if (word == "stopped")
      part.stopped = true;
    else if (word == "made")
      part.made = true;
    else
      part.models.push_back(word);
  }
  if (part.models.empty()) part.models.push_back(e.model);
  return part;
}

/// Returns the exchanges of a file in which the simulator takes part.
inline std::vector<test::Exchange> simulated(const std::string& file) {
  auto exchanges = test::read_frames(file);
  std::erase_if(exchanges, [](const test::Exchange& e) { return e.simulated == "-"; });
  return exchanges;
}

/// Carries out the exchange with `plc`, which is as it was made, and compares reply and memory.
inline void expect_exchange(const test::Exchange& e, const Personality& personality, Plc plc) {
  const auto part = part_in(e);
  const auto family = plc.memory().model().family;
  auto before = memory_runs(part.before, family);
  auto after = memory_runs(part.after, family);
  const auto is = [&e](std::string_view operation) {
    return e.operation.find(operation) != std::string::npos;
  };
  if (e.simulated.find('=') == std::string::npos && !part.made && e.device != "-" &&
      !is("refused")) {
    const bool whole_bytes = personality.protocol() == Protocol::programming_port;
    if (is("read") || is("gather")) before = memory_of(e, family, whole_bytes);
    if (is("write") || is("scatter") || is("force_")) after = memory_of(e, family, whole_bytes);
  }
  plc.set_running(!part.stopped);
  preset(plc, after, ~0U);  // so that an untouched device never looks right
  preset(plc, before);
  EXPECT_EQ(to_hex(replies_of(personality, plc, e.request)), to_hex(e.reply));
  EXPECT_EQ(differences(plc, after), "");
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
