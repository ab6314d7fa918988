#include "agent/cli/recording/replay_report.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <string_view>
#include <utility>

#include "agent/text/json.h"
#include "agent/text/text.h"
#include "protocol/explanation.h"

namespace fxagent {
namespace {

using Way = RecordedFrame::Way;
using Json = nlohmann::ordered_json;

/// Builds blocks of a pcapng file, draft-ietf-opsawg-pcapng, little endian.
class Pcapng final {
 public:
  Pcapng() {
    constexpr std::uint32_t kSection = 0x0A0D0D0A;
    constexpr std::uint32_t kInterface = 1;
    constexpr std::uint32_t kUser0 = 147;
    Bytes section;
    put(section, 0x1A2B3C4D, 4);
    put(section, 1, 2);  // major version
    put(section, 0, 2);
    put(section, ~std::uint64_t{0}, 8);  // length of the section: not given
    block(kSection, section);
    Bytes interface;
    put(interface, kUser0, 2);
    put(interface, 0, 2);
    put(interface, 0, 4);  // no limit of a packet's length
    block(kInterface, interface);
  }

  void packet(std::int64_t at_us, const Bytes& bytes) {
    constexpr std::uint32_t kPacket = 6;
    const auto time = static_cast<std::uint64_t>(std::max<std::int64_t>(at_us, 0));
    Bytes packet;
    put(packet, 0, 4);  // interface
    put(packet, time >> 32, 4);
    put(packet, time & 0xFFFFFFFF, 4);
    put(packet, bytes.size(), 4);
    put(packet, bytes.size(), 4);
    packet.insert(packet.end(), bytes.begin(), bytes.end());
    block(kPacket, packet);
  }

  Bytes take() { return std::move(file_); }

 private:
  static void put(Bytes& out, std::uint64_t value, int bytes) {
    for (int i = 0; i < bytes; ++i) out.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
  }
  void block(std::uint32_t type, const Bytes& body) {
    const std::size_t padding = (4 - body.size() % 4) % 4;
    const std::size_t length = 12 + body.size() + padding;
    put(file_, type, 4);
    put(file_, length, 4);
    file_.insert(file_.end(), body.begin(), body.end());
    put(file_, 0, static_cast<int>(padding));
    put(file_, length, 4);
  }

  Bytes file_;
};

/// Appends the length, two bytes with the high byte first, and the text, cut to that length.
void put_text(Bytes& out, std::string_view text) {
  text = text.substr(0, 0xFFFF);
  out.push_back(static_cast<std::uint8_t>(text.size() >> 8));
  out.push_back(static_cast<std::uint8_t>(text.size()));
  out.insert(out.end(), text.begin(), text.end());
}

/// The packet that config/wireshark/fxagent.lua takes apart.
Bytes packet_of(const Replay& replay, const RecordedFrame& frame) {
  constexpr std::uint8_t kVersion = 1;
  constexpr std::size_t kMostFields = 255;
  const auto explanation = replay.explain(frame);
  Bytes out{kVersion, static_cast<std::uint8_t>(frame.way)};
  put_text(out, replay.recording().head.link);
  put_text(out, replay.device_of(frame));
  put_text(out, frame.device == kNoDevice
                    ? std::string_view()
                    : std::string_view(replay.recording().devices[frame.device].protocol));
  put_text(out, ms_text(frame.after));
  put_text(out, meaning_of(frame, explanation));
  const std::size_t fields =
      explanation ? std::min(explanation->fields.size(), kMostFields) : std::size_t{0};
  out.push_back(static_cast<std::uint8_t>(fields));
  for (std::size_t i = 0; i < fields; ++i) {
    put_text(out, explanation->fields[i].first);
    put_text(out, explanation->fields[i].second);
  }
  out.insert(out.end(), frame.bytes.begin(), frame.bytes.end());
  return out;
}

}  // namespace

Json explanation_json(const Explanation& frame) {
  Json out;
  const auto put = [&](const char* key, const auto& value) {
    if (value) out[key] = *value;
  };
  out["ok"] = frame.ok;
  out["direction"] = frame.direction == Direction::request ? "request" : "reply";
  out["ambiguous"] = frame.ambiguous;
  out["operation"] = frame.operation;
  put("command", frame.command);
  put("command_set", frame.command_set);
  put("device", frame.device);
  put("count", frame.count);
  if (!frame.values.empty()) out["values"] = frame.values;
  if (frame.checksum_given || frame.checksum_computed) {
    auto& sum = out["checksum"] = Json::object();
    if (frame.checksum_given) sum["given"] = *frame.checksum_given;
    if (frame.checksum_computed) sum["computed"] = *frame.checksum_computed;
  }
  out["error"] = nullptr;
  put("error", frame.error);
  return out;
}

std::string replay_text(const Replay& replay) {
  const RecordingHead& head = replay.recording().head;
  std::string text = escaped("link " + head.link + ", " + head.wire, Escape::message) +
                     "\nwritten " + utc_us_text(head.written_us) + ": " +
                     escaped(head.reason, Escape::message) + "\n";
  for (const RecordedFrame& frame : replay.recording().frames) {
    text += utc_us_text(frame.at_us) + ' ' + std::string(to_string(frame.way));
    text +=
        ' ' +
        (replay.device_of(frame).empty() ? "-" : escaped(replay.device_of(frame), Escape::message));
    if (frame.after.count() > 0) text += ' ' + ms_text(frame.after) + " ms";
    if (!frame.bytes.empty()) text += "  " + to_hex(frame.bytes);
    if (const std::string meaning = meaning_of(frame, replay.explain(frame)); !meaning.empty())
      text += "  " + meaning;
    text += '\n';
  }
  return text;
}

std::string replay_json(const Replay& replay) {
  const RecordingHead& head = replay.recording().head;
  Json first{{"agent", head.agent},     {"version", head.version}, {"link", head.link},
             {"wire", head.wire},       {"reason", head.reason},   {"written_us", head.written_us},
             {"devices", Json::array()}};
  for (const RecordedDevice& device : replay.recording().devices) {
    Json options = Json::object();
    for (const auto& [key, value] : device.options)
      std::visit([&, name = key](const auto& of) { options[name] = of; }, value);
    first["devices"].push_back(
        {{"name", device.name}, {"protocol", device.protocol}, {"options", std::move(options)}});
  }
  std::string text = dumped(first) + "\n";
  for (const RecordedFrame& frame : replay.recording().frames) {
    Json line{{"at_us", frame.at_us}, {"way", to_string(frame.way)}};
    if (frame.device != kNoDevice) line["device"] = replay.device_of(frame);
    if (frame.after.count() > 0) line["after_ms"] = static_cast<double>(frame.after.count()) / 1e6;
    line["hex"] = to_hex(frame.bytes);
    if (!frame.note.empty()) line["note"] = frame.note;
    if (const auto explanation = replay.explain(frame)) {
      line["says"] = summary(*explanation);
      line["explanation"] = explanation_json(*explanation);
    }
    text += dumped(line) + "\n";
  }
  return text;
}

Bytes replay_pcapng(const Replay& replay) {
  Pcapng file;
  for (const RecordedFrame& frame : replay.recording().frames)
    file.packet(frame.at_us, packet_of(replay, frame));
  return file.take();
}

}  // namespace fxagent
