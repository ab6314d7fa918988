// A made-up protocol that reads several places in one frame, for tests of the code that uses such
// frames. The test chooses commands, ways and prices; the frames are lists of numbers.
#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "protocol/codec.h"

namespace fxagent::test {

/// Characters of one command: for the frame, and for each part in addition to two per byte.
struct GatherPrice {
  std::uint32_t fixed = 12;
  std::uint32_t each = 6;
};

/// Words are "W5" in space 0, "V5" in space 1 …; bits "B5" are in space 1 too.
class GatheringCodec : public Codec, public AddressSpace {
 public:
  std::map<std::uint16_t, std::vector<ReadWay>> ways;
  std::vector<GatherCommand> commands;
  std::map<std::uint8_t, GatherPrice> prices;

  Result<Address> parse_address(std::string_view text, std::optional<DataType>) const override {
    const auto number = static_cast<std::uint32_t>(std::stoul(std::string(text.substr(1))));
    const std::string name(text);
    if (text[0] == 'B') return Address{name, {1, number, 1}, Unit::bit, true};
    const std::uint16_t space = text[0] == 'W' ? 0 : 1;
    return Address{name, {space, number * 16, 16}, Unit::word, true};
  }
  Result<Span> parse_range(std::string_view text) const override {
    return parse_address(text, std::nullopt)->span;
  }
  std::string name_of(const Span& span) const override {
    return (span.space == 0 ? "W" : "V") + std::to_string(span.first_bit / 16);
  }
  Result<void> check_range(const Span&) const override { return {}; }
  Result<void> check_write(const Span&) const override { return {}; }
  std::vector<ReadWay> read_ways(std::uint16_t space) const override {
    const auto found = ways.find(space);
    return found == ways.end() ? std::vector<ReadWay>{} : found->second;
  }
  std::vector<GatherCommand> gathers() const override { return commands; }
  std::uint32_t max_write_bits(std::uint16_t) const override { return 512; }

  const AddressSpace& addresses() const override { return *this; }
  /// The number of the exchange, 'R', then space, first bit, bits, way and command of each part,
  /// two bytes each.
  Result<Bytes> encode(const Request& request, std::uint16_t tag) const override {
    Bytes frame{static_cast<std::uint8_t>(tag), 'R'};
    const auto put = [&](std::uint32_t number) {
      frame.push_back(static_cast<std::uint8_t>(number));
      frame.push_back(static_cast<std::uint8_t>(number >> 8));
    };
    for (const Read& read : reads_of(request))
      for (const std::uint32_t number :
           {std::uint32_t{read.span.space}, read.span.first_bit, read.span.bits,
            std::uint32_t{read.way}, std::uint32_t{read.gather}})
        put(number);
    return frame;
  }
  /// The number, then 'N' and a code, or 'D', the length and the image.
  Result<std::optional<Reply>> decode(const Request&, std::uint16_t tag,
                                      ByteView rx) const override {
    if (rx.size() < 3) return std::optional<Reply>{};
    if (rx[0] != static_cast<std::uint8_t>(tag))
      return fail(ErrorCode::bad_frame, "another number");
    Reply reply;
    if (rx[1] == 'N') {
      reply.kind = Reply::Kind::nak;
      reply.device_code = rx[2];
      reply.text = "no " + std::to_string(rx[2]);
      reply.consumed = 3;
      return std::optional<Reply>(reply);
    }
    const std::size_t size = rx[2];
    if (rx.size() < 3 + size) return std::optional<Reply>{};
    reply.kind = Reply::Kind::data;
    reply.image.assign(rx.begin() + 3, rx.begin() + 3 + static_cast<std::ptrdiff_t>(size));
    reply.consumed = 3 + size;
    return std::optional<Reply>(reply);
  }
  Explanation explain(ByteView, std::optional<Direction>) const override { return {}; }
  Recovery after_silence() const override { return Recovery::none; }
  Recovery after_nonsense() const override { return Recovery::none; }
  LineLength line_length(const Request& request) const override {
    const std::vector<Read> reads = reads_of(request);
    if (reads.empty()) return {10, 5, 0};
    std::uint32_t data = 0;
    for (const Read& read : reads) data += (read.span.bits + 7) / 8 * 2;
    if (!std::holds_alternative<Gather>(request)) return {5, 5 + data, 0};
    for (const GatherCommand& command : commands)
      if (command.gather == reads.front().gather &&
          (reads.size() > command.max_parts || data / 2 * 8 > command.max_bits))
        return {};  // not a frame
    const GatherPrice& price = prices.at(reads.front().gather);
    return {price.fixed + price.each * static_cast<std::uint32_t>(reads.size()), data, 0};
  }
  static constexpr int kHole = 1;
  static constexpr int kBusy = 2;
  static constexpr int kCurable = 3;
  static constexpr int kUnknownCommand = 4;
  RefusalMeaning meaning_of(const Request&, int code) const override {
    switch (code) {
      case kHole:
        return RefusalMeaning::hole;
      case kBusy:
        return RefusalMeaning::busy;
      case kCurable:
        return RefusalMeaning::curable;
      default:
        return RefusalMeaning::final;
    }
  }

 private:
  static std::vector<Read> reads_of(const Request& request) {
    if (const auto* gather = std::get_if<Gather>(&request)) return gather->parts;
    if (const auto* read = std::get_if<Read>(&request)) return {*read};
    return {};
  }
};

/// A way that reads words at even places, at most `most` of them.
inline ReadWay word_way(std::uint8_t way, std::uint32_t most, std::uint8_t gather = 0) {
  ReadWay out{.way = way, .end_bit = 64'000};
  out.align_bits = out.unit_bits = 16;
  out.max_bits = most * 16;
  out.gather = gather;
  return out;
}

/// Words, and bits in blocks of 64 words. Command 1 is a random read of words and double words,
/// command 2 reads blocks.
inline GatheringCodec gathering_codec() {
  GatheringCodec codec;
  for (std::uint16_t space = 0; space < 2; ++space)
    codec.ways[space] = {word_way(0, 64), word_way(1, 2, 1), word_way(2, 64, 2)};
  codec.commands = {{1, 24}, {2, 12, 96 * 16}};
  codec.prices = {{1, {14, 6}}, {2, {14, 10}}};
  return codec;
}

}  // namespace fxagent::test
