// Frames written as text, and what a codec makes of an answer; for the tests of all protocols.
#pragma once

#include <gtest/gtest.h>

#include <string>
#include <string_view>

#include "protocol/codec.h"
#include "protocol/control_characters.h"

namespace fxagent::test {

/// Returns the bytes of a frame written as text, with marks for control characters: < STX, > ETX,
/// % ENQ, + ACK, - NAK, ! CR LF.
inline Bytes ascii(std::string_view text) {
  constexpr std::string_view kMarks = "<>%+-";
  constexpr std::uint8_t kMeant[] = {kStx, kEtx, kEnq, kAck, kNak};
  Bytes bytes;
  for (const char c : text) {
    const auto mark = kMarks.find(c);
    if (c == '!')
      bytes.insert(bytes.end(), {kCr, kLf});
    else
      bytes.push_back(mark < kMarks.size() ? kMeant[mark] : static_cast<std::uint8_t>(c));
  }
  return bytes;
}

/// Returns the first `count` of the bytes.
inline Bytes first(ByteView bytes, std::size_t count) {
  return {bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(count)};
}

inline bool needs_more(const Codec& codec, const Request& request, ByteView rx,
                       std::uint16_t tag = 1) {
  const auto reply = codec.decode(request, tag, rx);
  return reply && !*reply;
}

/// Returns the answer in `rx`; a default one, and a failure, if there is none.
inline Reply answer(const Codec& codec, const Request& request, ByteView rx,
                    std::uint16_t tag = 1) {
  const auto reply = codec.decode(request, tag, rx);
  EXPECT_TRUE(reply && *reply) << (reply ? "needs more" : reply.error().text);
  return reply && *reply ? **reply : Reply{};
}

/// Returns what the codec says of `rx`, which must be a bad frame.
inline std::string fault(const Codec& codec, const Request& request, ByteView rx,
                         std::uint16_t tag = 1) {
  const auto reply = codec.decode(request, tag, rx);
  EXPECT_FALSE(reply);
  if (reply) return {};
  EXPECT_EQ(reply.error().code, ErrorCode::bad_frame);
  return reply.error().text;
}

inline void expect_says(const std::string& text, std::string_view part) {
  EXPECT_NE(text.find(part), std::string::npos) << text;
}

}  // namespace fxagent::test
