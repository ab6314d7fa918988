// Explains one 1E frame for `fxagent decode` and the line trace. Not used to decode polls.
#include <algorithm>
#include <string>

#include "protocol/device_walk.h"
#include "protocol/mc/one_e.h"

namespace fxagent::mc {
namespace one_e {
namespace {

struct KnownCommand;

/// Walks a frame in its binary form after its command. In ASCII code numbers are high byte first.
class Walk final : public DeviceWalk {
 public:
  Walk(Explanation& out, NumberForm form, ByteView rest, Model model)
      : DeviceWalk(out, form, rest), model_(model) {}

  void request(const KnownCommand& command);
  void answer(const KnownCommand& command);

  void timer(const Field& field) {
    const std::uint32_t timer = number(field);
    show(field.name, timer == 0 ? "none" : std::to_string(timer * kTimerStepMs) + " ms");
  }
  void zero(const Field& field) {
    if (number(field.digits, "its points") != 0)
      fault("the byte after the number of points is not 00");
  }

  void bits_read(const Field& field) {
    const ByteView data = data_read(field);
    if (good() && !add_bits(out_, form_, data, 2 * data.size())) fault("the data are not bits");
  }
  void words_read(const Field& field) {
    const ByteView data = data_read(field);
    if (data.size() % 2 != 0) return fault("an odd count of bytes cannot be words");
    add_values(out_, form_, data, 4);
  }
  void model_read(const Field& field) {
    const ByteView data = data_read(field);
    if (!good()) return;
    const std::string_view name = model_coded(data[0]);
    out_.values.push_back(hex_text(data[0], 2));
    show("model", name.empty() ? "an unknown one" : name);
  }

 private:
  std::optional<FrameDevice> device_in(ByteView wire) override;
  ByteView data_read(const Field& field);
  void refusal(int end_code);

  Model model_;
};

constexpr Fields kRequestHead = {read_by<&Walk::hex>("PC number", 2),
                                 read_by<&Walk::timer>("monitoring timer", 4)};
constexpr Field kBitDevice = read_by<&Walk::bit_device>("device", 12);
constexpr Field kWordDevice = read_by<&Walk::word_device>("device", 12);
constexpr Field kPoints = read_by<&Walk::points>("points", 2);
constexpr Field kPointsTo256 = read_by<&Walk::points_to_256>("points", 2);
constexpr Field kZero = read_by<&Walk::zero>("", 2);
constexpr Field kBits = read_by<&Walk::bits>("data");
constexpr Field kWords = read_by<&Walk::words>("data");
constexpr Field kBitItems = read_by<&Walk::bit_items>("", 12);
constexpr Field kWordItems = read_by<&Walk::word_items>("", 12);
constexpr Field kText = read_by<&Walk::text>("text");
constexpr Field kBitsRead = read_by<&Walk::bits_read>("data");
constexpr Field kWordsRead = read_by<&Walk::words_read>("data");
constexpr Field kModelRead = read_by<&Walk::model_read>("data");
constexpr Field kData = read_by<&Walk::rest>("data");

/// `answer` is what follows the end code 00. A write has nothing there.
struct KnownCommand {
  Command code;
  std::string_view operation;
  std::string_view meaning;
  Fields request;
  Fields answer;
};
constexpr KnownCommand kCommands[] = {
    {Command::read_bits, "read", "read of bits", {kBitDevice, kPointsTo256, kZero}, {kBitsRead}},
    {Command::read_words, "read", "read of words", {kWordDevice, kPoints, kZero}, {kWordsRead}},
    {Command::write_bits, "write", "write of bits", {kBitDevice, kPoints, kZero, kBits}, {}},
    {Command::write_words, "write", "write of words", {kWordDevice, kPoints, kZero, kWords}, {}},
    {Command::random_bits, "write", "write of scattered bits", {kPoints, kZero, kBitItems}, {}},
    {Command::random_words, "write", "write of scattered words", {kPoints, kZero, kWordItems}, {}},
    {Command::run, "other", "remote RUN", {}, {}},
    {Command::stop, "other", "remote STOP", {}, {}},
    {Command::model, "other", "which PLC is this", {}, {kModelRead}},
    {Command::loop_back, "other", "loop-back test", {kText}, {kData}},
};

std::optional<FrameDevice> Walk::device_in(ByteView wire) {
  const bool code_first = form_ == NumberForm::high_first;
  const auto code =
      static_cast<std::uint16_t>(*number_in(form_, code_first ? wire.first(2) : wire.last(2)));
  const std::uint32_t number = *number_in(form_, code_first ? wire.last(4) : wire.first(4));
  auto space = space_coded_1e(code);
  if (!space) return std::nullopt;
  // M8000 up, D8000 up and CN200 up of an FX3 are separate spaces with the same code.
  for (std::uint16_t i = 0; i < kSpaces; ++i) {
    const auto other = static_cast<Space>(i);
    if (kind_of(other).one_e == code && has_device(model_, other, number)) space = other;
  }
  return FrameDevice{device_name(model_, *space, number), kind_of(*space).bits};
}

void Walk::request(const KnownCommand& command) {
  if (command.operation == "other") show("meaning", command.meaning);
  if (left() < 6) return fault("the request is truncated");
  walk(kRequestHead);
  walk(command.request);
  if (good() && left() != 0) fault(std::to_string(left_.size()) + " bytes are left over");
}

ByteView Walk::data_read(const Field& field) {
  out_.operation = "data";
  const ByteView data = left_;
  rest(field);
  if (data.empty()) fault("there are no data");
  return data;
}

void Walk::refusal(int end_code) {
  out_.operation = "nak";
  if (left_.size() != 0 && left_.size() != 2)
    return fault("only an abnormal code and 00 may follow an end code");
  const auto abnormal = left_.empty() ? std::nullopt : std::optional<int>(left_[0]);
  show("reason", one_e::refusal(end_code, abnormal));
}

void Walk::answer(const KnownCommand& command) {
  if (left() == 0) return fault("the answer is truncated");
  const auto end_code = static_cast<int>(number(2, "its end code"));
  if (end_code != 0) return refusal(end_code);
  show("end code", "00, done");
  if (command.answer[0].read == nullptr) {
    out_.operation = "ack";
    if (left() == 0) return;
    rest(kData);
    return fault("nothing follows the end code of a write");
  }
  walk(command.answer);
  if (!out_.values.empty()) out_.count = static_cast<std::uint32_t>(out_.values.size());
}

}  // namespace
}  // namespace one_e

Explanation OneE::explain(ByteView frame, std::optional<Direction> direction) const {
  using namespace one_e;
  Explanation out = begin_explanation(direction);
  if (frame.empty()) return wrong(out, "no bytes");
  // No command or answer begins with the code of a digit.
  const bool in_ascii = hex_digit(frame[0]) >= 0;
  const auto binary =
      in_ascii ? from_ascii(frame) : std::optional(Bytes(frame.begin(), frame.end()));
  out.fields.emplace_back("data code", in_ascii ? "ASCII" : "binary");
  if (!binary || (in_ascii && frame.size() % 2 != 0))
    return wrong(out, "a frame in ASCII has pairs of hex digits only");
  const std::uint8_t first = binary->front();
  const bool is_answer = (first & kAnswer) != 0;
  const auto* command = std::ranges::find(kCommands, static_cast<one_e::Command>(first & ~kAnswer),
                                          &KnownCommand::code);
  if (command == std::end(kCommands))
    return wrong(out, hex_text(first, 2) + " is neither a command of a 1E frame nor its answer");
  out.direction = is_answer ? Direction::reply : Direction::request;
  out.operation = command->operation;
  out.command = hex_text(code(command->code), 2);
  out.fields.emplace_back("command", *out.command + ", " + std::string(command->meaning));
  if (direction && *direction != out.direction)
    return wrong(out, hex_text(first, 2) + " begins " + (is_answer ? "an answer" : "a request"));
  Walk walk(out, in_ascii ? NumberForm::high_first : NumberForm::low_first,
            ByteView(*binary).subspan(1), settings_.model);
  if (is_answer)
    walk.answer(*command);
  else
    walk.request(*command);
  return out;
}

}  // namespace fxagent::mc
