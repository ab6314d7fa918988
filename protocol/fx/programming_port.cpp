#include "protocol/fx/programming_port.h"

#include <algorithm>

#include "protocol/encoding.h"

namespace fxagent::fx {
namespace {

using Settings = ProgrammingPort::Settings;

// GX Developer never requests more, and the buffers of some converters and clones hold no more.
constexpr std::uint32_t kClassicBytes = 64;
// An FX3U was observed to answer a request for FEh bytes by E00.
constexpr std::uint32_t kFx3Bytes = 254;
// STX before the payload; ETX and two digits of sum after it.
constexpr std::uint32_t kEnvelope = 4;
// The longest frame: the answer to a read of 254 bytes.
constexpr std::size_t kLongestFrame = 2 * kFx3Bytes + kEnvelope;

constexpr std::uint32_t kForcedStop = 37;  // M8037: forced STOP

std::uint8_t way_of(CommandSet set) {
  return set == CommandSet::classic ? ProgrammingPort::kClassicWay : ProgrammingPort::kExtendedWay;
}

/// Wraps a payload: STX, payload, ETX, sum.
Bytes framed(std::string_view command, const std::vector<std::pair<std::uint32_t, int>>& numbers,
             ByteView data) {
  Bytes frame;
  frame.reserve(command.size() + data.size() * 2 + 6 + kEnvelope);
  frame.push_back(kStx);
  frame.insert(frame.end(), command.begin(), command.end());
  for (const auto& [number, digits] : numbers) append_hex(frame, number, digits);
  for (const std::uint8_t byte : data) append_hex(frame, byte, 2);
  frame.push_back(kEtx);
  append_hex(frame, byte_sum(ByteView(frame).subspan(1)), 2);
  return frame;
}

/// Place [begin, end) of the first whole frame at or after `from`, where rx holds STX. A further
/// STX restarts the frame: the part before it was cut off. nullopt if its end has not arrived.
struct FramePlace {
  std::size_t begin = 0;
  std::size_t end = 0;
};
std::optional<FramePlace> find_frame(ByteView rx, std::size_t from) {
  std::size_t begin = from;
  std::size_t etx = 0;  // 0: not seen
  for (std::size_t i = from + 1; i < rx.size(); ++i) {
    if (rx[i] == kStx) {
      begin = i;
      etx = 0;
    } else if (etx != 0) {
      if (i == etx + 2) return FramePlace{begin, i + 1};
    } else if (rx[i] == kEtx) {
      etx = i;
    }
  }
  return std::nullopt;
}

/// Requests more bytes, or fails if more bytes than the longest frame have arrived without a frame.
Decoded wait_for_more(ByteView rx, std::size_t from) {
  if (rx.size() - from > kLongestFrame)
    return garbled(std::to_string(rx.size() - from) +
                   " bytes without a whole frame; the longest has " +
                   std::to_string(kLongestFrame));
  return std::nullopt;
}

Reply nak(std::size_t consumed) {
  return {.kind = Reply::Kind::nak,
          .text = "NAK (the programming port gives no reason)",
          .began = consumed - 1,
          .consumed = consumed};
}

/// Decodes the data frame rx[at.begin, at.end) as the answer to a read of `bytes` bytes.
Decoded data_reply(ByteView rx, FramePlace at, std::size_t bytes) {
  const ByteView frame = rx.subspan(at.begin, at.end - at.begin);
  const ByteView payload = frame.subspan(1, frame.size() - kEnvelope);
  auto why = why_wrong_sum(frame.last(2), frame.subspan(1, frame.size() - 3));
  if (!why.empty()) return garbled(std::move(why));
  if (payload.size() != bytes * 2)
    return garbled(std::to_string(payload.size()) + " data digits given, " +
                   std::to_string(bytes * 2) + " expected");
  auto image = bytes_in(payload);
  if (!image) return fail(image);
  return Reply{
      .kind = Reply::Kind::data, .image = std::move(*image), .began = at.begin, .consumed = at.end};
}

/// Decodes an answer with data. Skips an echo of the request, which is never an answer.
Decoded decode_data(ByteView rx, ByteView request, std::size_t bytes) {
  std::size_t at = 0;
  for (;;) {
    const std::size_t from = at;
    while (at < rx.size() && rx[at] != kStx && rx[at] != kNak) ++at;
    if (at == rx.size()) return wait_for_more(rx, from);
    if (rx[at] == kNak) return nak(at + 1);
    const auto place = find_frame(rx, at);
    if (!place) return wait_for_more(rx, at);
    const ByteView frame = rx.subspan(place->begin, place->end - place->begin);
    if (!std::equal(frame.begin(), frame.end(), request.begin(), request.end()))
      return data_reply(rx, *place, bytes);
    at = place->end;
  }
}

/// Decodes a bare ACK or NAK. Skips whole frames before it: the echo of the request, or a late
/// answer to an older read.
Decoded decode_acknowledge(ByteView rx) {
  std::size_t at = 0;
  while (at < rx.size()) {
    if (rx[at] == kNak) return nak(at + 1);
    if (rx[at] == kAck) return Reply{.began = at, .consumed = at + 1};
    if (rx[at] != kStx) {
      ++at;
      continue;
    }
    const auto place = find_frame(rx, at);
    if (!place) return wait_for_more(rx, at);
    at = place->end;
  }
  return wait_for_more(rx, 0);
}

std::uint32_t word_at(const std::vector<Bytes>& images, std::size_t index) {
  if (index >= images.size() || images[index].size() < 2) return 0;
  return images[index][0] + images[index][1] * 256U;
}

/// True if the force is a RUN or a STOP.
bool switches_run(const Force& force) {
  return force.space == id(Space::special_m) && force.bit == kForcedStop;
}

tl::unexpected<Error> no_address(const Span& span) {
  return refuse(device_name(span) +
                ": no document gives the place of the extension registers R for the programming "
                "port; use the computer link");
}

}  // namespace

Result<std::shared_ptr<const Codec>> ProgrammingPort::make(const Options& options) {
  Settings settings;
  if (const auto* name = option<std::string>(options, "model"); name && *name != kAutoModel) {
    const auto known = model_named(*name);
    if (!known) return refuse("no model '" + *name + "'");
    settings.model = *known;
  }
  if (const auto* commands = option<std::string>(options, "command_set")) {
    if (*commands == "classic") settings.commands = Commands::classic;
    if (*commands == "extended") settings.commands = Commands::extended;
  }
  if (settings.commands == Commands::extended && settings.model != Model::unknown_fx &&
      map_of(settings.model, CommandSet::extended).empty())
    return refuse(std::string(to_string(settings.model)) + " has only the classic command set");
  take_option(settings.max_block_bytes, options, "max_block_bytes", 2, kFx3Bytes);
  return std::make_shared<const ProgrammingPort>(settings);
}

// ---- addresses and ranges ----------------------------------------------------------------------

Result<Address> ProgrammingPort::parse_address(std::string_view text,
                                               std::optional<DataType> type) const {
  auto address = fx::parse_address(settings_.model, text, type);
  if (address && address->span.space == id(Space::r)) return no_address(address->span);
  return address;
}

Result<Span> ProgrammingPort::parse_range(std::string_view text) const {
  auto span = fx::parse_range(settings_.model, text);
  if (span && span->space == id(Space::r)) return no_address(*span);
  return span;
}

Result<void> ProgrammingPort::check_range(const Span& span) const {
  if (span.space == id(Space::r)) return no_address(span);
  return fx::check_range(settings_.model, span);
}

// ---- ways to read ------------------------------------------------------------------------------

namespace {

std::uint32_t max_read_bytes(const Settings& settings, CommandSet set) {
  const bool long_frames = set == CommandSet::extended && settings.model >= Model::fx3s;
  return std::min(settings.max_block_bytes, long_frames ? kFx3Bytes : kClassicBytes);
}

/// Returns the sets that this model and these settings allow, best first.
std::vector<CommandSet> sets_of(const Settings& settings) {
  std::vector<CommandSet> allowed;
  if (settings.commands != ProgrammingPort::Commands::extended)
    allowed.push_back(CommandSet::classic);
  if (settings.commands != ProgrammingPort::Commands::classic &&
      !map_of(settings.model, CommandSet::extended).empty())
    allowed.push_back(CommandSet::extended);
  return allowed;
}

std::vector<ReadWay> ways_of(const Settings& settings, Space space, CommandSet set) {
  std::vector<ReadWay> ways;
  const PortArea* area = area_of(map_of(settings.model, set), space);
  if (area == nullptr || !is_addressed(id(space))) return ways;
  const DeviceKind& kind = kind_of(space);
  const std::uint32_t unit = std::max<std::uint32_t>(kind.bits, 8);
  for (const Numbers& run : numbers_of(settings.model, space)) {
    const Span span = span_of(space, run);
    const std::uint32_t end = std::min(span.end_bit(), area->bits());
    if (span.first_bit >= end) continue;
    ways.push_back({.way = way_of(set),
                    .tier = way_of(set),
                    .first_bit = span.first_bit / unit * unit,
                    .end_bit = (end + unit - 1) / unit * unit,
                    .align_bits = unit,
                    .unit_bits = unit,
                    .max_bits = std::max(max_read_bytes(settings, set) * 8 / unit * unit, unit)});
  }
  return ways;
}

/// Returns the set that writes or forces `span`. Error: unsupported if no set reaches it.
Result<CommandSet> set_for(const Settings& settings, const Span& span) {
  for (const CommandSet set : sets_of(settings)) {
    const PortArea* area = area_of(map_of(settings.model, set), static_cast<Space>(span.space));
    if (area != nullptr && span.end_bit() <= area->bits()) return set;
  }
  return fail(ErrorCode::unsupported,
              device_name(span) + " needs the extended command set" +
                  (settings.model == Model::unknown_fx ? ", and the model is not known"
                                                       : ", which is not in use"));
}

}  // namespace

std::vector<ReadWay> ProgrammingPort::read_ways(std::uint16_t space) const {
  std::vector<ReadWay> ways;
  for (const CommandSet set : sets_of(settings_))
    for (const ReadWay& way : ways_of(settings_, static_cast<Space>(space), set))
      ways.push_back(way);
  return ways;
}

std::vector<std::uint32_t> ProgrammingPort::borders(std::uint16_t space) const {
  // A clone of the FX2N keeps the M of the classic map and those from M1536 on in two places, and
  // answers a read across the border with wrong bits. A genuine FX2N loses nothing: the part before
  // the border fills three whole frames.
  const bool has_fx2n_map = settings_.model == Model::fx1n || settings_.model == Model::fx2n;
  if (space != id(Space::m) || !has_fx2n_map) return {};
  return {area_of(map_of(settings_.model, CommandSet::classic), Space::m)->bits()};
}

std::uint32_t ProgrammingPort::max_write_bits(std::uint16_t space) const {
  if (space >= kSpaces) return 0;
  const std::uint32_t unit = std::max<std::uint32_t>(width_of(space), 8);
  return std::max(std::min(settings_.max_block_bytes, kClassicBytes) * 8 / unit * unit, unit);
}

// ---- bytes --------------------------------------------------------------------------------------

namespace {

Result<Bytes> encode_read(const Settings& settings, const Read& read) {
  const bool classic = read.way == ProgrammingPort::kClassicWay;
  const auto set = classic ? CommandSet::classic : CommandSet::extended;
  const auto space = static_cast<Space>(read.span.space);
  const auto way = way_for(
      ways_of(settings, space, set), way_of(set), read.span, [&] { return device_name(read.span); },
      classic ? "reached with the classic command set" : "reached with the extended command set");
  if (!way) return fail(way);
  const std::uint32_t address =
      area_of(map_of(settings.model, set), space)->address + read.span.first_bit / 8;
  return framed(classic ? "0" : "E00", {{address, 4}, {read.span.bits / 8, 2}}, {});
}

/// `most` is the largest number of bits in one write.
Result<Bytes> encode_write(const Settings& settings, std::uint32_t most, const Write& write) {
  const Span& span = write.span;
  if (const auto allowed = fx::check_write(settings.model, span); !allowed) return fail(allowed);
  auto why = span.bits % 8 != 0 ? "only whole bytes can be written" : why_wrong_image(write, most);
  if (!why.empty()) return refuse(device_name(span) + ": " + why);
  const auto set = set_for(settings, span);
  if (!set) return fail(set);
  const PortArea* area = area_of(map_of(settings.model, *set), static_cast<Space>(span.space));
  return framed(*set == CommandSet::classic ? "1" : "E10",
                {{area->address + span.first_bit / 8, 4}, {span.bits / 8, 2}}, write.image);
}

Result<Bytes> encode_force(const Settings& settings, const Force& force) {
  const Span span{force.space, force.bit, 1};
  // RUN and STOP are forces of M8037. check_write() protects it from all other requests.
  if (!switches_run(force)) {
    if (const auto allowed = fx::check_write(settings.model, span); !allowed) return fail(allowed);
  }
  const auto set = set_for(settings, span);
  if (!set) return fail(set);
  const PortArea* area = area_of(map_of(settings.model, *set), static_cast<Space>(force.space));
  if (!area->force) return refuse(device_name(span) + " is a word: only bits can be forced");
  const std::uint32_t address = (*area->force + force.bit) & 0xFFFF;
  // Low byte first, unlike the address in a read.
  const bool classic = *set == CommandSet::classic;
  const std::string_view command = force.on ? (classic ? "7" : "E7") : (classic ? "8" : "E8");
  return framed(command, {{address & 0xFF, 2}, {address >> 8, 2}}, {});
}

}  // namespace

Result<Bytes> ProgrammingPort::encode(const Request& request, std::uint16_t /*tag*/) const {
  if (std::holds_alternative<Enquire>(request)) return Bytes{kEnq};
  if (const auto* read = std::get_if<Read>(&request)) return encode_read(settings_, *read);
  if (const auto* write = std::get_if<Write>(&request))
    return encode_write(settings_, max_write_bits(write->span.space), *write);
  if (const auto* force = std::get_if<Force>(&request)) return encode_force(settings_, *force);
  return fail(ErrorCode::unsupported,
              "the programming port has no such command; RUN and STOP are forces of M8037");
}

Decoded ProgrammingPort::decode(const Request& request, std::uint16_t tag, ByteView rx) const {
  const auto sent = encode(request, tag);
  if (!sent) return fail(sent);
  if (const auto* read = std::get_if<Read>(&request))
    return decode_data(rx, *sent, read->span.bits / 8);
  return decode_acknowledge(rx);
}

bool ProgrammingPort::may_pass_for_answer(ByteView bytes) const {
  return std::any_of(bytes.begin(), bytes.end(), [](std::uint8_t byte) {
    return byte == kAck || byte == kNak || byte == kStx;
  });
}

LineLength ProgrammingPort::line_length(const Request& request) const {
  LineLength length;
  if (const auto frame = encode(request, 0))
    length.request_chars = static_cast<std::uint32_t>(frame->size());
  const auto* read = std::get_if<Read>(&request);
  length.reply_chars = read == nullptr ? 1 : kEnvelope + read->span.bits / 8 * 2;
  return length;
}

// ---- probe, model, RUN and STOP ----------------------------------------------------------------

std::optional<Request> ProgrammingPort::probe(std::uint32_t number) const {
  Read probe = std::get<Read>(run_state());
  probe.span.bits += 8 * (number % std::min(kProbes, settings_.max_block_bytes));
  return probe;
}

std::vector<Request> ProgrammingPort::identify() const {
  // Every FX answers the classic read of D8001. The answer of FX0N, FX1S and FX1N to D8101 is
  // unknown.
  return {Read{span_of(Space::special_d, {8001, 8001}), kClassicWay},
          Read{span_of(Space::special_d, {8101, 8101}), kClassicWay}};
}

std::optional<std::string> ProgrammingPort::model_from(const std::vector<Bytes>& images) const {
  // The thousands are the type, the rest is the version: 24310 is type 24, V3.10.
  const std::uint32_t type = word_at(images, 0) / 1000;
  const bool second_known = images.size() > 1 && images[1].size() >= 2;
  const std::uint32_t second = word_at(images, 1) / 1000;
  const auto name = [](Model model) { return std::string(to_string(model)); };
  switch (type) {
    case 22:
      return name(Model::fx1s);
    case 24:
      if (second == 16) return name(Model::fx3u);
      // FX2N repeats 24 or has no D8101. Any other value is a clone that might use either extended
      // map, and the wrong map reads wrong devices. GX Works2 takes 0 for an FX3U; an agent must
      // not guess.
      if (!second_known || second == 24) return name(Model::fx2n);
      return std::nullopt;
    case 26:
      return name(second == 26 ? Model::fx3g : Model::fx1n);
    case 28:
      return name(Model::fx3s);  // unverified: no capture of an FX3S is known
    default:
      return std::nullopt;
  }
}

std::shared_ptr<const Codec> ProgrammingPort::with_model(std::string_view model) const {
  const auto known = model_named(model);
  if (!known) return nullptr;
  Settings settings = settings_;
  settings.model = *known;
  return std::make_shared<const ProgrammingPort>(settings);
}

Request ProgrammingPort::run_state() const {
  // M8000 is on while the PLC runs. Until the model is known, only the classic address is known.
  // Every FX has it.
  const auto allowed = sets_of(settings_);
  const CommandSet set = allowed.empty() ? CommandSet::classic : allowed.front();
  return Read{span_of(Space::special_m, {8000, 8007}), way_of(set)};
}

Request ProgrammingPort::run_request(bool run) const {
  return Force{id(Space::special_m), kForcedStop, !run};
}

std::string ProgrammingPort::run_hint() const {
  return "the PLC's RUN/STOP switch (and its RUN terminal, if one is assigned) must be at RUN";
}

RefusalMeaning ProgrammingPort::meaning_of(const Request& request, int /*device_code*/) const {
  // A NAK gives no reason, so it may be due to noise on the request, and a repeat may succeed.
  // Never repeat RUN and STOP: the switch decides, and it might have been turned before the repeat.
  const auto* force = std::get_if<Force>(&request);
  const bool runs_or_stops = force != nullptr && switches_run(*force);
  return runs_or_stops ? RefusalMeaning::final : RefusalMeaning::curable;
}

}  // namespace fxagent::fx
