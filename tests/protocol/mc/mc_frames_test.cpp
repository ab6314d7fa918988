// Every exchange of tests/frames/mc_3e.txt, mc_4e.txt, mc_3c.txt and mc_4c.txt, in both directions.
#include <gtest/gtest.h>

#include "protocol/mc/mc.h"
#include "tests/protocol/answers.h"

namespace fxagent::mc {
namespace {

std::vector<std::string> split(const std::string& text, char by) {
  std::vector<std::string> parts;
  std::istringstream stream(text);
  for (std::string part; std::getline(stream, part, by);) parts.push_back(part);
  return parts;
}

struct Wire {
  Mc codec;
  std::uint16_t tag = 0;
};

/// Returns the codec described by the second line of a block.
Wire wire_of(Frame frame, const test::Exchange& e) {
  Mc::Settings settings;
  settings.frame = frame;
  if (e.model != "auto") settings.model = *model_named(e.model);
  const auto parts = split(e.command_set, '.');
  const auto number = [&](std::size_t i, int base = 10) {
    return static_cast<std::uint32_t>(std::stoul(parts.at(i), nullptr, base));
  };
  std::uint16_t tag = 0;
  if (is_serial(frame)) {
    settings.format = number(0);
    settings.station = static_cast<std::uint8_t>(number(1));
    tag = static_cast<std::uint16_t>(number(6, 16));
  } else {
    settings.code = parts.at(0) == "ascii" ? Code::ascii : Code::binary;
    tag = static_cast<std::uint16_t>(number(1, 16));
  }
  settings.route = {static_cast<std::uint8_t>(number(2)), static_cast<std::uint8_t>(number(3)),
                    static_cast<std::uint16_t>(number(4)), static_cast<std::uint8_t>(number(5))};
  return {Mc(settings), tag};
}

Span place(const Mc& codec, const std::string& name, std::uint32_t words) {
  const auto address = codec.parse_address(name, std::nullopt);
  EXPECT_TRUE(address) << name << ": " << (address ? "" : address.error().text);
  Span span = address.value_or(Address{}).span;
  if (words != 0) span.bits = words * 16;
  return span;
}

/// Parses "D0*1,D1500*2" (with the number of words), or "M50,Y2F".
std::vector<Span> places(const Mc& codec, const test::Exchange& e) {
  std::vector<Span> spans;
  for (const std::string& one : split(e.device, ',')) {
    const auto parts = split(one, '*');
    spans.push_back(place(codec, parts[0],
                          parts.size() < 2 ? 0 : static_cast<std::uint32_t>(std::stoul(parts[1]))));
  }
  return spans;
}

std::optional<Request> request_of(const Mc& codec, const test::Exchange& e) {
  const std::string& what = e.operation;
  if (what == "identify") return Control{Control::Kind::identify};
  if (what == "run") return Control{Control::Kind::run};
  if (what == "stop") return Control{Control::Kind::stop};
  if (what.starts_with("explained")) return std::nullopt;
  const auto spans = places(codec, e);
  const auto bits_from_first = [&](std::uint32_t bits) {
    return Span{spans.at(0).space, spans.at(0).first_bit, bits};
  };
  if (what == "read_words" || what == "nak") return Read{bits_from_first(16 * e.bytes), kWordWay};
  if (what == "read_bits") return Read{bits_from_first(e.bytes), kBitWay};
  if (what == "write_words") return Write{bits_from_first(16 * e.bytes), e.image};
  if (what == "force_on") return Force{spans.at(0).space, spans.at(0).first_bit, true};
  if (what.starts_with("gather")) {
    const bool blocks = what == "gather_blocks";
    Gather gather;
    for (const Span& span : spans)
      gather.parts.push_back(
          {span, blocks ? kBlockWay : kRandomWay, blocks ? kBlockRead : kRandomRead});
    return gather;
  }
  Scatter scatter;
  std::size_t at = 0;
  for (const Span& span : spans) {
    const std::size_t size = (span.bits + 7) / 8;
    scatter.parts.push_back({span, test::first(ByteView(e.image).subspan(at), size)});
    at += size;
  }
  return scatter;
}

struct File {
  const char* name;
  Frame frame;
  int spoken;
  int understood;
  int explained;
};
constexpr File kFiles[] = {{"mc_3e.txt", Frame::e3, 18, 15, 24},
                           {"mc_4e.txt", Frame::e4, 11, 11, 19},
                           {"mc_3c.txt", Frame::c3, 6, 6, 6},
                           {"mc_4c.txt", Frame::c4, 10, 9, 11}};

class McFrames : public testing::TestWithParam<File> {};

TEST_P(McFrames, SpeaksAndUnderstandsEveryExchange) {
  int spoken = 0;
  int understood = 0;
  for (const test::Exchange& e : test::read_frames(GetParam().name)) {
    SCOPED_TRACE(e.where());
    const Wire wire = wire_of(GetParam().frame, e);
    const auto request = request_of(wire.codec, e);
    if (!request) continue;
    test::expect_spoken(wire.codec, *request, e, wire.tag);
    ++spoken;
    if (e.reply.empty()) continue;
    const Reply reply = test::answer(wire.codec, *request, e.reply, wire.tag);
    ++understood;
    EXPECT_EQ(reply.consumed, e.reply.size());
    if (e.operation == "nak") {
      EXPECT_EQ(reply.kind, Reply::Kind::nak);
      EXPECT_EQ(reply.device_code, e.image[0] | e.image[1] << 8);
      EXPECT_FALSE(reply.text.empty());
      continue;
    }
    EXPECT_EQ(reply.kind, brings_data(*request) ? Reply::Kind::data : Reply::Kind::ack);
    if (brings_data(*request)) {
      EXPECT_EQ(to_hex(reply.image), to_hex(e.image));
    }
    // Doubled bytes of format 5 are counted only if they are predictable: not in values.
    if (e.source.find("doubled, length") == std::string::npos) {
      EXPECT_EQ(wire.codec.line_length(*request).reply_chars, e.reply.size());
    }
  }
  EXPECT_EQ(spoken, GetParam().spoken);
  EXPECT_EQ(understood, GetParam().understood);
}

TEST_P(McFrames, ExplainsEveryFrameByItself) {
  int explained = 0;
  for (const test::Exchange& e : test::read_frames(GetParam().name)) {
    SCOPED_TRACE(e.where());
    const Wire wire = wire_of(GetParam().frame, e);
    const auto asked = request_of(wire.codec, e);
    const Explanation request = wire.codec.explain(e.request, std::nullopt);
    // Two captures violate the manual's layout, and their PLCs refused them.
    const bool is_wrong = e.source.find("not the layout of the manual") != std::string::npos;
    EXPECT_EQ(request.ok, !is_wrong) << request.error.value_or("");
    EXPECT_EQ(request.direction, Direction::request);
    EXPECT_FALSE(request.fields.empty());
    ++explained;
    if (e.operation.find("read") != std::string::npos || e.operation.starts_with("gather")) {
      EXPECT_EQ(request.operation, "read");
    }
    if (asked && e.device != "-") {
      std::string devices;
      for (const std::string& one : split(e.device, ','))
        devices += (devices.empty() ? "" : ",") + split(one, '*')[0];
      // In a gather the single words come first, as in these examples.
      EXPECT_EQ(request.device, devices);
    }
    if (e.reply.empty()) continue;
    const Explanation reply = wire.codec.explain(e.reply, std::nullopt);
    EXPECT_TRUE(reply.ok) << reply.error.value_or("");
    EXPECT_EQ(reply.direction, Direction::reply);
    const bool refused = e.operation == "nak" || is_wrong ||
                         e.source.find("4031H") != std::string::npos ||
                         e.source.find("7E40H") != std::string::npos;
    EXPECT_EQ(reply.operation == "nak", refused) << reply.operation;
    if (is_serial(GetParam().frame)) {
      EXPECT_EQ(request.checksum_given, request.checksum_computed);
      EXPECT_EQ(reply.checksum_given, reply.checksum_computed);
    }
  }
  EXPECT_EQ(explained, GetParam().explained);
}

INSTANTIATE_TEST_SUITE_P(Files, McFrames, testing::ValuesIn(kFiles),
                         [](const testing::TestParamInfo<File>& file) {
                           return std::string(file.param.name).substr(3, 2);
                         });

}  // namespace
}  // namespace fxagent::mc
