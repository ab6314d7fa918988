#include "protocol/modbus/modbus.h"

#include <algorithm>
#include <charconv>

#include "protocol/letter_case.h"
#include "protocol/range_ends.h"

namespace fxagent::modbus {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;

constexpr std::uint16_t kTables = 4;
constexpr std::string_view kForms =
    "hr:0 ir:0 co:0 di:0, hr:0.15 (a bit of a register), or 40001 30001 00001 10001";
// Serial Line V1.02, 2.5.1.1: 3.5 characters, and at least this time on any fast line.
constexpr nanoseconds kShortestGap = std::chrono::microseconds(1750);
// 2.4.1: every unit needs time to carry out a broadcast, 100 to 200 ms at 9600 baud.
constexpr milliseconds kBroadcastPause{200};
// Longest frames. Twice as many bytes without an answer are an error.
constexpr std::size_t kLongestRtu = 256;

bool is_digit(char c) { return c >= '0' && c <= '9'; }

/// Parses all of `text` as decimal, or as hexadecimal after 0x.
std::optional<std::uint32_t> number_in(std::string_view text) {
  int base = 10;
  if (text.starts_with("0x")) {
    text.remove_prefix(2);
    base = 16;
  }
  std::uint32_t number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number, base);
  if (text.empty() || error != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  return number;
}

std::optional<Space> table_named(std::string_view letters) {
  for (std::uint16_t i = 0; i < kTables; ++i)
    if (letters_of(static_cast<Space>(i)) == letters) return static_cast<Space>(i);
  return std::nullopt;
}

/// One coil or register, or a bit of a register.
struct TablePlace {
  Space space = Space::coil;
  std::uint32_t number = 0;
  std::optional<std::uint32_t> bit;
};

/// Parses "40101": the first digit is the table, the others count from 1.
Result<TablePlace> parse_numbered(const std::string& quoted, std::string_view digits) {
  if (digits.size() != 5 && digits.size() != 6)
    return refuse(quoted + ": a number without a table has 5 or 6 digits, as 40101 or 400101");
  TablePlace place;
  constexpr std::string_view kTableDigits = "0134";  // as in Space
  const std::size_t table = kTableDigits.find(digits[0]);
  if (table == kTableDigits.npos)
    return refuse(quoted +
                  ": the first digit must be 0 (coils), 1 (discrete inputs), 3 (input registers) "
                  "or 4 (holding registers)");
  place.space = static_cast<Space>(table);
  const auto number = number_in(digits.substr(1));
  if (!number || *number == 0 || *number > kNumbers)
    return refuse(quoted + ": the numbers of this table go from " + digits[0] + "0001 to " +
                  digits[0] + "9999 or from " + digits[0] + "00001 to " + digits[0] + "65536" +
                  (digits.size() == 6
                       ? ""
                       : "; if this is the address itself, write " +
                             std::string(letters_of(place.space)) + ":" + std::string(digits)));
  place.number = *number - 1;
  return place;
}

Result<TablePlace> parse_place(std::string_view text, std::uint32_t base) {
  const std::string name = lower(text);
  const std::string quoted = "'" + std::string(text) + "'";  // as written
  std::string_view rest = name;
  std::optional<std::uint32_t> bit;
  if (const auto dot = rest.find('.'); dot != std::string_view::npos) {
    bit = number_in(rest.substr(dot + 1));
    if (!bit || *bit > 15) return refuse(quoted + ": the bits of a register are .0 to .15");
    rest = rest.substr(0, dot);
  }
  Result<TablePlace> place;
  if (!rest.empty() && std::all_of(rest.begin(), rest.end(), is_digit)) {
    place = parse_numbered(quoted, rest);
    if (!place) return place;
  } else {
    const auto colon = rest.find(':');
    const auto table = table_named(rest.substr(0, colon));
    if (colon == std::string_view::npos || !table)
      return refuse(quoted + " is not a Modbus address; the forms are " + std::string(kForms));
    const std::string_view digits = rest.substr(colon + 1);
    const auto number = number_in(digits);
    if (!number && (digits.empty() || !std::all_of(digits.begin(), digits.end(), is_digit)))
      return refuse(quoted + ": right after the colon must come a number, as in " +
                    std::string(letters_of(*table)) + ":100 or " + std::string(letters_of(*table)) +
                    ":0x64");
    if (!number || *number < base || *number - base >= kNumbers)
      return refuse(quoted + ": " + std::string(letters_of(*table)) + " goes from " +
                    std::to_string(base) + " to " + std::to_string(kNumbers - 1 + base));
    place->space = *table;
    place->number = *number - base;
  }
  if (bit && width_of(place->space) == 1)
    return refuse(quoted + ": only registers have bits; a coil is a bit");
  place->bit = bit;
  return place;
}

Span span_of_place(const TablePlace& place) {
  const std::uint32_t width = width_of(place.space);
  const Span whole{id(place.space), place.number * width, width};
  return place.bit ? Span{whole.space, whole.first_bit + *place.bit, 1} : whole;
}

/// True if an echo of the request could also be its answer. That is always so with 05, 06 and 22.
/// It is also so for reads of 17 to 24 coils or inputs from 768 to 1023, whose request has the form
/// of an answer.
bool answers_by_echo(const Request& request, ByteView pdu) {
  const auto reply = decode_pdu(request, pdu);
  return reply && *reply;
}

}  // namespace

std::string name_of(Space space, std::uint32_t number, std::uint32_t base) {
  return std::string(letters_of(space)) + ":" + std::to_string(number + base);
}

Result<std::shared_ptr<const Codec>> Modbus::make(Framing framing, const Options& options) {
  Settings settings;
  settings.framing = framing;
  take_option(settings.unit, options, "unit", 0, 255);
  take_option(settings.max_read, options, "max_read", 1, kMaxReadRegisters);
  take_option(settings.max_gap, options, "max_gap", 0, kMaxReadRegisters);
  take_option(settings.address_base, options, "address_base", 0, 1);
  if (const auto* word = option<std::string>(options, "byte_order")) {
    const auto order = byte_order_from(*word);
    if (!order) return fail(order);
    settings.order = *order;
  }
  take_option(settings.allow_read_modify_write, options, "allow_read_modify_write");
  if (framing != Framing::tcp && settings.unit > 247)
    return refuse(
        "unit must be 1 to 247 on a serial line, or 0 for a broadcast; 248 to 255 are reserved");
  return std::make_shared<const Modbus>(settings);
}

// ---- addresses and ranges ----------------------------------------------------------------------

Result<Address> Modbus::parse_address(std::string_view text,
                                      std::optional<DataType> /*type*/) const {
  const auto place = parse_place(text, settings_.address_base);
  if (!place) return fail(place);
  Address address;
  address.span = span_of_place(*place);
  const std::string name = modbus::name_of(place->space, place->number, settings_.address_base);
  address.text = place->bit ? name + "." + std::to_string(*place->bit) : name;
  address.unit = place->bit ? Unit::word_bit : width_of(place->space) == 1 ? Unit::bit : Unit::word;
  address.writable = place->space == Space::coil || place->space == Space::holding_register;
  return address;
}

Result<Span> Modbus::parse_range(std::string_view text) const {
  const RangeEnds ends = range_ends(text);
  const auto first = parse_place(ends.first, settings_.address_base);
  if (!first) return fail(first);
  auto last = first;
  if (ends.last) {
    std::string end(*ends.last);
    // "hr:100-119": the second end may omit the table of the first.
    if (text.find(':') != std::string_view::npos && end.find(':') == std::string::npos) {
      if (end.size() >= 5 && std::all_of(end.begin(), end.end(), is_digit))
        return refuse(std::string(text) + ": " + end +
                      " may be a number of its table or stand for " + "one, as 40101 does; write " +
                      std::string(letters_of(first->space)) + ":" + end);
      end.insert(0, std::string(letters_of(first->space)) + ":");
    }
    last = parse_place(end, settings_.address_base);
    if (!last) return fail(last);
  }
  const std::string name(text);
  if (first->bit || last->bit)
    return refuse(name + ": a range goes from one whole coil or register to another");
  if (first->space != last->space) return refuse(name + ": both ends must be in one table");
  if (last->number < first->number) return refuse(name + ": the range ends before it begins");
  Span span = span_of_place(*first);
  span.bits *= last->number - first->number + 1;
  return span;
}

Result<void> Modbus::check_range(const Span& span) const {
  if (span.space >= kTables)
    return refuse("space " + std::to_string(span.space) + " is not a table");
  const auto space = static_cast<Space>(span.space);
  const std::uint32_t width = width_of(space);
  const std::uint64_t end = std::uint64_t{kNumbers} * width;
  if (span.first_bit + std::uint64_t{span.bits} <= end) return {};
  const std::uint32_t count = (span.end_bit() - 1) / width - span.first_bit / width + 1;
  std::string fault = name_of(span);
  if (count > 1)
    fault += " needs " + std::to_string(count) + (width == 1 ? " bits, " : " registers, ") +
             names_of(*this, span);
  return refuse(fault + ": the table ends at " +
                modbus::name_of(space, kNumbers - 1, settings_.address_base));
}

Result<void> Modbus::check_write(const Span& span) const {
  if (auto present = check_range(span); !present) return present;
  if (span.bits == 0) return refuse("a write of nothing");
  if (span.space != id(Space::coil) && span.space != id(Space::holding_register))
    return refuse(name_of(span) + ": inputs cannot be written");
  const std::uint32_t width = width_of(static_cast<Space>(span.space));
  if (span.bits != 1 && (span.first_bit % width != 0 || span.bits % width != 0))
    return refuse(name_of(span) + ": only a single bit or whole registers can be written");
  return {};
}

std::string Modbus::name_of(const Span& span) const {
  if (span.space >= kTables) return "space " + std::to_string(span.space);
  const auto space = static_cast<Space>(span.space);
  return modbus::name_of(space, span.first_bit / width_of(space), settings_.address_base);
}

// ---- ways to read ------------------------------------------------------------------------------

std::vector<ReadWay> Modbus::read_ways(std::uint16_t space_id) const {
  if (space_id >= kTables) return {};
  const std::uint32_t width = width_of(static_cast<Space>(space_id));
  return {{.end_bit = kNumbers * width,
           .align_bits = width,
           .unit_bits = width,
           .max_bits = settings_.max_read * 16,
           .max_gap_bits = settings_.max_gap * 16}};
}

std::uint32_t Modbus::max_write_bits(std::uint16_t space) const {
  if (space == id(Space::coil)) return kMaxWriteBits;
  return space == id(Space::holding_register) ? kMaxWriteRegisters * 16 : 0;
}

// ---- frames ------------------------------------------------------------------------------------

namespace {

Decoded decode_rtu(std::uint8_t unit, const Request& request, ByteView pdu, ByteView rx) {
  const Bytes sent = framed(Framing::rtu, unit, pdu, 0);
  const bool echo_differs = !answers_by_echo(request, pdu);
  std::string error;
  bool pending = false;
  for (std::size_t at = 0; at < rx.size();) {
    const ByteView rest = rx.subspan(at);
    const std::size_t same = static_cast<std::size_t>(
        std::mismatch(rest.begin(), rest.end(), sent.begin(), sent.end()).first - rest.begin());
    if (echo_differs && same == sent.size()) {
      at += sent.size();
      continue;
    }
    pending |= same == rest.size();  // may be the echo so far
    if (const auto length = answer_length(rest.subspan(1))) {
      const Frame whole = rtu_frame(rx, at, *length);
      if (whole.state == Frame::State::good) {
        if (whole.unit == unit) {
          auto reply = decode_pdu(request, whole.pdu);
          if (!reply) return reply;
          if (*reply) {
            (*reply)->began = at;
            (*reply)->consumed = whole.end;
            return reply;
          }
        }
        at = whole.end;  // from another unit, or a late answer to another request
        continue;
      }
    }
    // Bytes that may still become the answer, or that would be the answer with a correct sum.
    const bool exception = rest.size() > 1 && rest[1] == (pdu[0] | kException);
    if (rest[0] != unit || rest.size() < 2 || (rest[1] != pdu[0] && !exception)) {
      ++at;
      continue;
    }
    const Frame frame = rtu_frame(rx, at, exception ? 2 : reply_length(request));
    pending |= frame.state == Frame::State::incomplete;
    if (error.empty()) error = frame.error;
    ++at;
  }
  if (!error.empty() && !pending) return garbled(error);
  if (rx.size() > 2 * kLongestRtu)
    return garbled(std::to_string(rx.size()) + " bytes without an answer");
  return std::nullopt;
}

/// Decodes frames that contain their own end: ASCII and TCP.
Decoded decode_delimited(const Modbus::Settings& settings, const Request& request, ByteView pdu,
                         std::uint16_t tag, ByteView rx) {
  const bool is_tcp = settings.framing == Framing::tcp;
  const bool echo_differs = !answers_by_echo(request, pdu);
  for (std::size_t at = 0;;) {
    const Frame frame = is_tcp ? tcp_frame(rx, at) : ascii_frame(rx, at);
    if (frame.state == Frame::State::incomplete) break;
    if (frame.state == Frame::State::wrong) return garbled(frame.error);
    const std::size_t began = at;
    at = frame.end;
    if (echo_differs && std::ranges::equal(frame.pdu, pdu)) continue;
    // A late answer to an older request, or on a shared line a frame of another unit.
    if (is_tcp ? frame.transaction != tag : frame.unit != settings.unit) continue;
    if (frame.unit != settings.unit)
      return garbled("unit " + std::to_string(frame.unit) + " answered, unit " +
                     std::to_string(settings.unit) + " was asked");
    auto reply = decode_pdu(request, frame.pdu);
    if (!reply) return reply;
    if (*reply) {
      (*reply)->began = began;
      (*reply)->consumed = frame.end;
      return reply;
    }
    if (is_tcp)
      return garbled("the answer is to another function, address or count: " + to_hex(frame.pdu));
  }
  if (!is_tcp && rx.size() > 2 * kLongestAscii)
    return garbled(std::to_string(rx.size()) + " bytes without an answer");
  return std::nullopt;
}

}  // namespace

Result<Bytes> Modbus::encode(const Request& request, std::uint16_t tag) const {
  if (const auto* read = std::get_if<Read>(&request)) {
    if (is_broadcast()) return fail(ErrorCode::unsupported, "no unit answers a broadcast");
    if (read->span.bits > settings_.max_read * 16)
      return refuse("a read takes at most max_read, " + std::to_string(settings_.max_read) +
                    " registers");
  }
  const auto pdu = encode_pdu(request);
  if (!pdu) return fail(pdu);
  return framed(settings_.framing, settings_.unit, *pdu, tag);
}

Decoded Modbus::decode(const Request& request, std::uint16_t tag, ByteView rx) const {
  const auto pdu = encode_pdu(request);
  if (!pdu) return fail(pdu);
  if (!expects_reply(request)) return fail(ErrorCode::unsupported, "no unit answers a broadcast");
  if (settings_.framing == Framing::rtu) return decode_rtu(settings_.unit, request, *pdu, rx);
  return decode_delimited(settings_, request, *pdu, tag, rx);
}

LineLength Modbus::line_length(const Request& request) const {
  LineLength length;
  const auto pdu = encode_pdu(request);
  const std::size_t sent = pdu ? pdu->size() : 0;
  length.request_chars = static_cast<std::uint32_t>(framed_length(settings_.framing, sent));
  if (expects_reply(request))
    length.reply_chars =
        static_cast<std::uint32_t>(framed_length(settings_.framing, reply_length(request)));
  return length;
}

// ---- refusals, recovery and pauses --------------------------------------------------------------

RefusalMeaning Modbus::meaning_of(const Request& request, int device_code) const {
  const Exception& exception = exception_coded(device_code);
  return std::holds_alternative<Read>(request) ? exception.for_read : exception.otherwise;
}

std::optional<Request> Modbus::instead_of(const Request& request, int device_code) const {
  if (device_code != 0x01) return std::nullopt;
  if (const auto* write = std::get_if<Write>(&request)) {
    const bool by_06 = write->span.space == id(Space::holding_register) && write->span.bits == 16 &&
                       write->way == id(WriteWay::first_choice);
    if (!by_06) return std::nullopt;
    Write several = *write;
    several.way = id(WriteWay::several);
    return several;
  }
  const auto* force = std::get_if<Force>(&request);
  if (force == nullptr || force->way != id(WriteWay::first_choice)) return std::nullopt;
  Force other = *force;
  const bool coil = force->space == id(Space::coil);
  if (!coil && !settings_.allow_read_modify_write) return std::nullopt;
  other.way = id(coil ? WriteWay::several : WriteWay::read_modify_write);
  return other;
}

std::optional<Request> Modbus::read_before(const Request& request) const {
  const auto* force = std::get_if<Force>(&request);
  if (force == nullptr || force->way != id(WriteWay::read_modify_write)) return std::nullopt;
  return Read{{force->space, force->bit / 16 * 16, 16}};
}

Request Modbus::with_read(const Request& request, ByteView image) const {
  const auto* force = std::get_if<Force>(&request);
  if (force == nullptr || image.size() < 2) return request;
  Write write{{force->space, force->bit / 16 * 16, 16}, {image[0], image[1]}};
  const auto mask = static_cast<std::uint8_t>(1U << (force->bit % 8));
  std::uint8_t& byte = write.image[force->bit % 16 / 8];
  byte = static_cast<std::uint8_t>(force->on ? byte | mask : byte & ~mask);
  return write;
}

nanoseconds Modbus::quiet_before(nanoseconds char_time) const {
  if (settings_.framing != Framing::rtu || char_time.count() == 0) return {};
  return std::max<nanoseconds>(char_time * 7 / 2, kShortestGap);
}

milliseconds Modbus::pause_after(const Request& request) const {
  return expects_reply(request) ? milliseconds{} : kBroadcastPause;
}

bool Modbus::may_pass_for_answer(ByteView bytes) const {
  if (settings_.framing != Framing::rtu)
    return settings_.framing == Framing::tcp || std::ranges::find(bytes, ':') != bytes.end();
  // The head of an answer that has not arrived completely.
  constexpr std::uint8_t kLastFunction = code(Function::read_write);
  if (bytes.size() >= 2 && bytes[0] == settings_.unit && bytes[1] != 0 &&
      (bytes[1] & ~kException) <= kLastFunction)
    return true;
  // A whole answer of any unit, or a read of another master.
  constexpr std::size_t kReadRequest = 5;
  for (std::size_t at = 0; at + 4 <= bytes.size(); ++at) {
    const auto length = answer_length(bytes.subspan(at + 1));
    if (length && rtu_frame(bytes, at, *length).state == Frame::State::good) return true;
    if (rtu_frame(bytes, at, kReadRequest).state == Frame::State::good) return true;
  }
  return false;
}

std::uint32_t Modbus::shorter_by(const Read& read) const {
  // Eight coils take one byte of an answer, a register takes two.
  return width_of(static_cast<Space>(read.span.space)) == 1 ? 8 : 16;
}

std::optional<Request> Modbus::presence() const {
  if (is_broadcast()) return std::nullopt;
  return Read{{id(Space::holding_register), 0, 16}};
}

std::optional<Request> Modbus::identity() const {
  if (is_broadcast()) return std::nullopt;
  return Control{Control::Kind::identify};
}

}  // namespace fxagent::modbus
