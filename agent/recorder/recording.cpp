#include "agent/recorder/recording.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <utility>

#include "agent/text/text.h"
#include "protocol/catalog.h"
#include "protocol/explanation.h"

namespace fxagent {
namespace {

using Way = RecordedFrame::Way;
using Fault = tl::unexpected<std::string>;

constexpr std::string_view kFirstLine = "fxagent-recording 1";
constexpr std::array<std::string_view, 4> kWays{"out", "in", "failed", "unasked"};  // as in Way
constexpr std::size_t kTimeText = std::string_view("2026-11-21T08:30:15.250123Z").size();
constexpr double kMostAfterMs = 1e9;

std::string one_line(std::string_view text) {
  std::string line(text);
  std::ranges::replace_if(line, is_control, '?');
  return line;
}

/// Returns the value of an option; nullopt if the protocol has no such option or value.
std::optional<OptionValue> option_value(const ProtocolInfo& protocol, std::string_view key,
                                        std::string_view text) {
  if (key == "model") return OptionValue(std::string(text));
  const auto spec = std::ranges::find(protocol.options, key, &OptionSpec::key);
  if (spec == protocol.options.end()) return std::nullopt;
  switch (spec->kind) {
    case OptionSpec::Kind::integer: {
      const auto number = number_from<std::int64_t>(text);
      if (!number || *number < spec->min || *number > spec->max) return std::nullopt;
      return OptionValue(*number);
    }
    case OptionSpec::Kind::boolean:
      if (text != "true" && text != "false") return std::nullopt;
      return OptionValue(text == "true");
    case OptionSpec::Kind::choice:
      if (std::ranges::find(spec->choices, text) == spec->choices.end()) return std::nullopt;
      return OptionValue(std::string(text));
  }
  return std::nullopt;
}

/// Returns the codec of the device; null if there is none with its protocol and options.
std::shared_ptr<const Codec> codec_of(const RecordedDevice& device) {
  const ProtocolInfo* protocol = find_protocol(device.protocol);
  if (protocol == nullptr) return nullptr;
  auto codec = protocol->make(device.options);
  return codec ? std::move(*codec) : nullptr;
}

std::string device_lines(std::size_t index, const RecordedDevice& device) {
  const std::string number = std::to_string(index);
  std::string text = "device " + number + " " + device.name + " " + device.protocol;
  for (const auto& [key, value] : device.options) text += " " + key + "=" + to_string(value);
  text += '\n';
  const auto codec = codec_of(device);
  if (const NumberPlace place = codec ? number_place(*codec) : NumberPlace{}; place.size > 0)
    text += "number " + number + " " + std::to_string(place.offset) + " " +
            std::to_string(place.size) + "\n";
  return text;
}

void append_frame(std::string& text, const RecordedFrame& frame) {
  text += utc_us_text(frame.at_us) + ' ' + std::string(to_string(frame.way)) + ' ';
  text += frame.device == kNoDevice ? "-" : std::to_string(frame.device);
  char after[32];
  std::snprintf(after, sizeof after, " %.3f ", static_cast<double>(frame.after.count()) / 1e6);
  text += after;
  std::string hex = to_hex(frame.bytes);
  std::erase(hex, ' ');
  text += hex.empty() ? "-" : hex;
  if (!frame.note.empty()) text += ' ' + one_line(frame.note);
  text += '\n';
}

std::optional<std::int64_t> us_from(std::string_view text) {
  if (text.size() != kTimeText || !text.ends_with('Z') || text[kTimeText - 8] != '.')
    return std::nullopt;
  const auto ms = utc_ms_from(text.substr(0, kTimeText - 8));
  const auto rest = number_from<std::uint32_t>(text.substr(kTimeText - 7, 6));
  if (!ms || !rest) return std::nullopt;
  return *ms * 1000 + *rest;
}

/// Takes a line `device`. Returns the fault in it, or an empty text.
std::string take_device(std::string_view line, Recording& out) {
  if (number_from<std::uint32_t>(take_until(line, ' ')) != out.devices.size())
    return "devices must be numbered 0, 1, 2 … in this order";
  if (out.devices.size() >= kNoDevice) return "a recording has at most 65,535 devices";
  RecordedDevice device;
  device.name = take_until(line, ' ');
  device.protocol = take_until(line, ' ');
  const ProtocolInfo* protocol = find_protocol(device.protocol);
  if (protocol == nullptr)
    return "there is no such protocol: `fxagent decode` without arguments lists them";
  device.options = default_options(*protocol);
  while (!line.empty()) {
    std::string_view text = take_until(line, ' ');
    const std::string_view key = take_until(text, '=');
    const auto value = option_value(*protocol, key, text);
    if (!value) return "a setting of the device is not one of its protocol's, or out of range";
    device.options[std::string(key)] = *value;
  }
  if (const auto codec = protocol->make(device.options); !codec) return codec.error().text;
  out.devices.push_back(std::move(device));
  return {};
}

/// Takes the line of a frame. Returns the fault in it, or an empty text.
std::string take_frame(std::string_view line, Recording& out) {
  RecordedFrame frame;
  const auto at = us_from(take_until(line, ' '));
  if (!at) return "the time must be as in 2026-11-21T08:30:15.250123Z";
  frame.at_us = *at;
  const auto way = std::ranges::find(kWays, take_until(line, ' '));
  if (way == kWays.end()) return "after the time, out, in, failed or unasked must follow";
  frame.way = static_cast<Way>(way - kWays.begin());
  const std::string_view device = take_until(line, ' ');
  const auto number = number_from<std::uint16_t>(device);
  if (device != "-" && (!number || *number >= out.devices.size()))
    return "the number of the device has no line `device`";
  frame.device = number.value_or(kNoDevice);
  const auto after = number_from<double>(take_until(line, ' '));
  if (!after || !(*after >= 0 && *after <= kMostAfterMs))
    return "the milliseconds must be a number from 0 to 1000000000";
  frame.after = std::chrono::nanoseconds(std::llround(*after * 1e6));
  const std::string_view hex = take_until(line, ' ');
  if (hex.empty()) return "the bytes are missing: two hex digits each, or - for none";
  if (hex != "-") {
    auto bytes = from_hex(hex);
    if (!bytes) return bytes.error().text;
    frame.bytes = std::move(*bytes);
  }
  frame.note = line;
  out.frames.push_back(std::move(frame));
  return {};
}

/// Takes any line after the first. Returns the fault in it, or an empty text.
std::string take_line(std::string_view line, Recording& out) {
  if (line.empty() || line.front() == '#') return {};
  if (line.front() >= '0' && line.front() <= '9') return take_frame(line, out);
  const std::string_view key = take_until(line, ' ');
  if (key == "device") return take_device(line, out);
  if (key == "number") return {};  // for programs that know no codec
  if (key == "agent") {
    out.head.agent = take_until(line, ' ');
    out.head.version = line;
  } else if (key == "link") {
    out.head.link = line;
  } else if (key == "wire") {
    out.head.wire = line;
  } else if (key == "reason") {
    out.head.reason = line;
  } else if (key == "written") {
    const auto at = us_from(line);
    if (!at) return "the time must be as in 2026-11-21T08:30:15.250123Z";
    out.head.written_us = *at;
  } else {
    return "the line begins with none of agent, link, wire, reason, written, device, number and "
           "a time: a newer fxagent may know it";
  }
  return {};
}

}  // namespace

std::string_view to_string(Way way) { return kWays[static_cast<std::size_t>(way)]; }

NumberPlace number_place(const Codec& codec) {
  if (codec.after_silence() != Recovery::none) return {};
  std::optional<Request> request = codec.presence();
  if (!request) request = codec.probe(0);
  if (!request) request = Request(Control{Control::Kind::identify});
  const auto low = codec.encode(*request, 0x0000);
  const auto high = codec.encode(*request, 0xFFFF);
  if (!low || !high || low->size() != high->size()) return {};
  const auto first = std::ranges::mismatch(*low, *high).in1;
  std::size_t end = low->size();
  while (end > 0 && (*low)[end - 1] == (*high)[end - 1]) --end;
  const auto offset = static_cast<std::size_t>(first - low->begin());
  return end > offset ? NumberPlace{offset, end - offset} : NumberPlace{};
}

std::string utc_us_text(std::int64_t utc_us) {
  const std::int64_t us = ((utc_us % 1000) + 1000) % 1000;
  std::string text = utc_text((utc_us - us) / 1000);
  char digits[8];
  std::snprintf(digits, sizeof digits, "%03dZ", static_cast<int>(us));
  if (text.ends_with('Z')) text.replace(text.size() - 1, 1, digits);
  return text;
}

std::string recording_text(const RecordingHead& head, const RecordedFrames& frames) {
  std::string text(kFirstLine);
  text += "\nagent " + head.agent + ' ' + head.version;
  text += "\nlink " + head.link;
  text += "\nwire " + one_line(head.wire);
  text += "\nwritten " + utc_us_text(head.written_us);
  text += "\nreason " + one_line(head.reason) + '\n';
  for (std::size_t i = 0; i < frames.devices.size(); ++i)
    text += device_lines(i, frames.devices[i]);
  text += "# time way device ms-since-request bytes note\n";
  for (const RecordedFrame& frame : frames.frames) append_frame(text, frame);
  return text;
}

tl::expected<Recording, std::string> parse_recording(std::string_view text) {
  if (text.size() > kMostRecordingBytes)
    return Fault("the file has " + std::to_string(text.size()) +
                 " bytes; a recording has at most " + std::to_string(kMostRecordingBytes) +
                 ": take a file that the recorder wrote");
  if (take_until(text, '\n') != kFirstLine)
    return Fault("line 1: a recording begins with \"" + std::string(kFirstLine) +
                 "\": take a file that the recorder wrote, or a newer fxagent");
  Recording out;
  for (std::size_t line = 2; !text.empty(); ++line) {
    const std::string why = take_line(take_until(text, '\n'), out);
    if (!why.empty()) return Fault("line " + std::to_string(line) + ": " + why);
  }
  return out;
}

Replay::Replay(Recording recording) : recording_(std::move(recording)) {
  for (const RecordedDevice& device : recording_.devices) codecs_.push_back(codec_of(device));
}

std::optional<Explanation> Replay::explain(const RecordedFrame& frame) const {
  if (frame.bytes.empty() || frame.device >= codecs_.size() || !codecs_[frame.device])
    return std::nullopt;
  return codecs_[frame.device]->explain(
      frame.bytes, frame.way == RecordedFrame::Way::out ? Direction::request : Direction::reply);
}

const std::string& Replay::device_of(const RecordedFrame& frame) const {
  static const std::string none;
  return frame.device < recording_.devices.size() ? recording_.devices[frame.device].name : none;
}

std::string meaning_of(const RecordedFrame& frame, const std::optional<Explanation>& explanation) {
  std::string meaning = frame.note;
  if (meaning.empty() && frame.way == RecordedFrame::Way::unasked) meaning = "unexpected bytes";
  if (explanation) meaning += (meaning.empty() ? "" : "; ") + summary(*explanation);
  return escaped(meaning, Escape::message);
}

}  // namespace fxagent
