// Frames written as text, what a codec makes of an answer, and the exchanges of tests/frames; for
// the tests of all protocols.
#pragma once

#include <gtest/gtest.h>

#include "protocol/codec.h"
#include "protocol/encoding.h"
#include "protocol/explanation.h"
#include "tests/support/says.h"
#include "tests/support/transcripts.h"

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

/// The exchanges of a file that this product can have, with their requests. `request_of` returns
/// nullopt for those that it never sends.
template <class RequestOf>
std::vector<std::pair<Exchange, Request>> spoken_in(const std::string& file, RequestOf request_of) {
  std::vector<std::pair<Exchange, Request>> all;
  for (Exchange& e : read_frames(file))
    if (auto request = request_of(e)) all.emplace_back(std::move(e), std::move(*request));
  return all;
}
/// Of these exchanges those with an answer.
template <class RequestOf>
std::vector<std::pair<Exchange, Request>> answered_in(const std::string& file,
                                                      RequestOf request_of) {
  auto all = spoken_in(file, request_of);
  std::erase_if(all, [](const auto& each) { return each.first.reply.empty(); });
  return all;
}

/// Expects the request of an exchange as `codec` encodes it.
inline void expect_spoken(const Codec& codec, const Request& request, const Exchange& e,
                          std::uint16_t tag = 0) {
  SCOPED_TRACE(e.where());
  const auto frame = codec.encode(request, tag);
  ASSERT_TRUE(frame) << frame.error().text;
  EXPECT_EQ(to_hex(*frame), to_hex(e.request));
  EXPECT_EQ(codec.line_length(request).request_chars, e.request.size());
}

/// Expects that `codec` understands the answer of an exchange, which is a refusal if `refused`.
inline Reply expect_understood(const Codec& codec, const Request& request, const Exchange& e,
                               bool refused, std::uint16_t tag = 0) {
  SCOPED_TRACE(e.where());
  Reply reply = answer(codec, request, e.reply, tag);
  EXPECT_EQ(reply.consumed, e.reply.size());
  if (refused) {
    EXPECT_EQ(reply.kind, Reply::Kind::nak);
    return reply;
  }
  EXPECT_EQ(reply.kind, brings_data(request) ? Reply::Kind::data : Reply::Kind::ack);
  if (brings_data(request)) {
    EXPECT_EQ(to_hex(reply.image), to_hex(e.image));
  }
  EXPECT_EQ(codec.line_length(request).reply_chars, e.reply.size());
  return reply;
}

/// Returns the write of an exchange to several devices, "M50,Y2F": bits or words. `span_of` gives
/// the place of a device.
template <class SpanOf>
Request scatter_of(const Exchange& e, SpanOf span_of) {
  Scatter scatter;
  std::istringstream devices(e.device);
  std::string device;
  const std::size_t width = e.image.size() / e.bytes;
  for (std::size_t at = 0; std::getline(devices, device, ','); at += width) {
    Write part{span_of(device), first(ByteView(e.image).subspan(at), width)};
    part.span.bits = width == 1 ? 1 : 16;
    scatter.parts.push_back(part);
  }
  return scatter;
}

/// Returns a request to force each of the first `count` bits of a space.
inline std::vector<Request> forces_of(std::uint16_t space, std::uint32_t count) {
  std::vector<Request> requests;
  for (std::uint32_t i = 0; i < count; ++i) requests.emplace_back(Force{space, i, true});
  return requests;
}
/// Returns a request to write zero to each of the first `count` words of a space.
inline std::vector<Request> writes_of(std::uint16_t space, std::uint32_t count) {
  std::vector<Request> requests;
  for (std::uint32_t i = 0; i < count; ++i)
    requests.emplace_back(Write{{space, i * 16, 16}, Bytes(2)});
  return requests;
}

/// Returns the field of an explanation.
inline std::string field(const Explanation& out, std::string_view name) {
  for (const auto& [key, value] : out.fields)
    if (key == name) return value;
  return "(none)";
}

}  // namespace fxagent::test
