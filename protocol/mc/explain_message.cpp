// Explains messages of 3E, 4E, 3C and 4C (message.h).
#include <algorithm>

#include "protocol/device_walk.h"
#include "protocol/mc/body.h"
#include "protocol/mc/message.h"

namespace fxagent::mc {
namespace {

constexpr std::uint32_t kByBits = 1;  // bits of the subcommand
constexpr std::uint32_t kLongCodes = 2;
constexpr std::uint32_t kExtension = 0x80;

/// Parses the digits of a device number in ASCII. Leading zeros may be blanks.
std::optional<std::uint32_t> digits_in(ByteView text, std::uint32_t base) {
  std::uint64_t number = 0;
  for (const std::uint8_t c : text) {
    const int digit = c == ' ' ? 0 : hex_digit(c);
    if (digit < 0 || static_cast<std::uint32_t>(digit) >= base) return std::nullopt;
    number = number * base + static_cast<std::uint32_t>(digit);
  }
  return static_cast<std::uint32_t>(number);
}

/// Walks a request.
class MessageWalk final : public DeviceWalk {
 public:
  MessageWalk(Explanation& out, Model model, Code code, ByteView message)
      : DeviceWalk(out, form_of(code), message), model_(model), code_(code) {}

  void explain();

  /// A number that is not shown.
  void skipped(const Field& field) { number(field); }
  void run_mode(const Field& field) {
    const std::uint32_t mode = number(field);
    show(field.name, hex_text(mode, 4) + (mode == 3 ? ", forced" : ", not forced"));
  }

  void head(const Field& field) { next_device(field.name); }
  void points(const Field& field) {
    points_ = number(field.digits, "the number of points");
    out_.count = by_bits() ? points_ : devices_in(points_);
    show(field.name, std::to_string(points_) + (by_bits() ? " bits" : " words"));
    if (points_ == 0) fault("a request for no points");
  }
  void data(const Field& /*field*/) {
    if (!by_bits()) return values(points_, 4, device_.bits);
    const ByteView wire = take(points_, "its data");
    if (good() && !add_bits(out_, form_, wire, points_))
      fault("its data are " + to_hex(wire) + " but bits are 0 and 1");
  }

  // Two counts begin a request of several places: of words and double words, or of blocks of words
  // and of bits.
  void first_count(const Field& field) { first_ = count(field); }
  void second_count(const Field& field) { second_ = count(field); }

  /// A write has the value of each place behind it.
  void places(const Field& field) {
    out_.count = first_ + second_;
    for (std::uint32_t i = 0; i < *out_.count && good(); ++i) {
      next_device();
      if (writes()) values(1, i < first_ ? 4 : 8);
    }
    show(field.name, out_.device.value_or(""));
  }
  void bit_places(const Field& field) {
    out_.count = number(2, "the number of bits");
    for (std::uint32_t i = 0; i < *out_.count && good(); ++i) {
      next_device();
      out_.values.emplace_back(number(is_long() ? 4 : 2, "its data") != 0 ? "1" : "0");
    }
    show(field.name, out_.device.value_or(""));
  }

  /// A write has the data of each block behind its head.
  void blocks(const Field& field) {
    std::uint32_t total = 0;
    for (std::uint32_t i = 0; i < first_ + second_; ++i) {
      next_device();
      const std::uint32_t points = number(4, "the number of points");
      if (!good()) return;
      if ((i >= first_) != (device_.bits == 1))
        return fault(device_.name + " among the blocks of " + (i < first_ ? "words" : "bits"));
      total += devices_in(points);
      show(field.name, device_.name + ", " + std::to_string(points) + " words");
      if (writes()) values(points, 4, device_.bits);
    }
    out_.count = total;
  }

 private:
  bool by_bits() const { return (subcommand_ & kByBits) != 0; }
  bool writes() const { return out_.operation == "write"; }
  bool is_long() const { return (subcommand_ & kLongCodes) != 0; }
  /// Returns the devices in words of the last device's kind.
  std::uint32_t devices_in(std::uint32_t words) const {
    return device_.bits == 1 ? 16 * words : words;
  }

  std::string cut_before(std::string_view what) const override {
    return "the frame ends before " + std::string(what);
  }
  std::optional<FrameDevice> device_in(ByteView wire) override;

  void next_device(std::string_view name = {}) { device({nullptr, name, is_long() ? 12U : 8U}); }
  std::uint32_t count(const Field& field) {
    const std::uint32_t count = number(field.digits, "the number of " + std::string(field.name));
    show(field.name, std::to_string(count));
    return count;
  }
  void values(std::uint32_t count, std::size_t digits, std::uint32_t device_bits = 16) {
    const ByteView wire = take(count * digits, "its data");
    if (code_ == Code::ascii && !is_hex(wire)) fault("its data are not hex digits");
    if (good()) add_values(out_, form_, wire, digits, device_bits);
  }

  Model model_;
  Code code_;
  std::uint32_t subcommand_ = 0;
  std::uint32_t first_ = 0;
  std::uint32_t second_ = 0;
};

constexpr Field kHead = read_by<&MessageWalk::head>("device");
constexpr Field kPoints = read_by<&MessageWalk::points>("points", 4);
constexpr Field kData = read_by<&MessageWalk::data>("");
constexpr Field kWordCount = read_by<&MessageWalk::first_count>("words", 2);
constexpr Field kDwordCount = read_by<&MessageWalk::second_count>("double words", 2);
constexpr Field kPlaces = read_by<&MessageWalk::places>("devices");
constexpr Field kBitPlaces = read_by<&MessageWalk::bit_places>("devices");
constexpr Field kWordBlocks = read_by<&MessageWalk::first_count>("word blocks", 2);
constexpr Field kBitBlocks = read_by<&MessageWalk::second_count>("bit blocks", 2);
constexpr Field kBlocks = read_by<&MessageWalk::blocks>("block");
constexpr Field kRunMode = read_by<&MessageWalk::run_mode>("mode", 4);
constexpr Field kMode = read_by<&MessageWalk::hex>("mode", 4);
constexpr Field kClearMode = read_by<&MessageWalk::skipped>("clear mode", 2);
constexpr Field kLastByte = read_by<&MessageWalk::skipped>("last byte", 2);
constexpr Field kRest = read_by<&MessageWalk::rest>("data");

constexpr Fields kAnything = {kRest};
constexpr Fields kPlaceList = {kWordCount, kDwordCount, kPlaces};
constexpr Fields kBlockList = {kWordBlocks, kBitBlocks, kBlocks};

/// The first row that fits a request is its kind. Names as in SH-080008.
struct Message {
  std::uint16_t command;
  std::string_view name;
  std::string_view operation;
  Fields fields;
  bool only_by_bits = false;
};
constexpr Message kMessages[] = {
    {0x0101, "read type name", "other", {}},
    {0x0401, "batch read", "read", {kHead, kPoints}},
    {0x0403, "random read", "read", kPlaceList},
    {0x0406, "block read", "read", kBlockList},
    {0x0613, "buffer memory read", "other", kAnything},
    {0x0619, "loopback test", "other", kAnything},
    {0x0801, "register monitor data", "other", kAnything},
    {0x0802, "monitor", "other", kAnything},
    {0x1001, "remote RUN", "other", {kRunMode, kClearMode, kLastByte}},
    {0x1002, "remote STOP", "other", {kMode}},
    {0x1003, "remote PAUSE", "other", {kMode}},
    {0x1005, "remote latch clear", "other", {kMode}},
    {0x1006, "remote RESET", "other", {kMode}},
    {0x1401, "batch write", "write", {kHead, kPoints, kData}},
    {0x1402, "random write", "write", {kBitPlaces}, true},
    {0x1402, "random write", "write", kPlaceList},
    {0x1406, "block write", "write", kBlockList},
    {0x1617, "clear error", "other", kAnything},
    {0x1630, "remote password unlock", "other", kAnything},
    {0x1631, "remote password lock", "other", kAnything},
};
constexpr Message kUnknownMessage = {0, "not known to this program", "other", kAnything};

const Message& message_of(std::uint32_t command, bool by_bits) {
  const auto* found =
      std::find_if(std::begin(kMessages), std::end(kMessages), [&](const Message& known) {
        return known.command == command && (by_bits || !known.only_by_bits);
      });
  return found == std::end(kMessages) ? kUnknownMessage : *found;
}

std::optional<FrameDevice> MessageWalk::device_in(ByteView wire) {
  std::optional<std::uint32_t> number;
  std::optional<Space> space;
  if (code_ == Code::binary) {
    const std::size_t bytes = is_long() ? 4 : 3;
    number = number_in(form_, wire.first(bytes));
    space = space_coded(wire[bytes]);
  } else {
    const std::size_t letters = is_long() ? 4 : 2;
    space = space_coded(as_text(wire.first(letters)));
    if (space) number = digits_in(wire.subspan(letters), ascii_base_of(model_, *space));
  }
  if (!space || !number) {
    fault("not a device: " + data_text(form_, wire));
    return std::nullopt;
  }
  // An FX5 counts M8000 up among its M. No FX3 uses these frames.
  return FrameDevice{device_name(model_, *space, *number), kind_of(*space).bits};
}

void MessageWalk::explain() {
  const std::uint32_t command = number(4, "the command");
  subcommand_ = number(4, "the subcommand");
  if (!good()) return;
  const Message& message = message_of(command, by_bits());
  out_.command = hex_text(command, 4);
  out_.operation = message.operation;
  show("command", *out_.command + ", " + std::string(message.name));
  show("subcommand", hex_text(subcommand_, 4) + (is_long() ? ", codes of iQ-R" : ""));
  const bool is_extended = out_.operation != "other" && (subcommand_ & kExtension) != 0;
  walk(is_extended ? kAnything : message.fields);
  if (good() && left() != 0)
    fault(std::to_string(left_.size()) + " characters more than the request has");
}

}  // namespace

void explain_request(Model model, Code code, ByteView message, Explanation& out) {
  out.direction = Direction::request;
  out.operation = "other";
  out.ok = true;
  MessageWalk(out, model, code, message).explain();
}

bool is_known_command(std::uint32_t command) {
  return &message_of(command, true) != &kUnknownMessage;
}

void explain_data(Code code, ByteView data, Explanation& out) {
  out.direction = Direction::reply;
  out.ok = true;
  out.operation = data.empty() ? "ack" : "data";
  if (data.empty()) return;
  const std::size_t word = wire_size(code, 2);
  constexpr std::size_t kModelCode = 2;
  if (data.size() == kTypeName + wire_size(code, kModelCode) && is_printable(data.first(kTypeName)))
    out.fields.emplace_back("type name, if it is one", as_text(data.first(kTypeName)));
  if (data.size() % word == 0 && (code == Code::binary || is_hex(data))) {
    add_values(out, form_of(code), data, 4);
    out.count = static_cast<std::uint32_t>(data.size() / word);
  }
  out.fields.emplace_back("data", data_text(form_of(code), data));
}

void explain_refusal(Model model, std::uint16_t end_code, Explanation& out) {
  out.direction = Direction::reply;
  out.ok = true;
  out.operation = "nak";
  out.values.push_back(hex_text(end_code, 4));
  out.fields.emplace_back("reason", end_code_text(end_code, series_of(model)));
}

}  // namespace fxagent::mc
