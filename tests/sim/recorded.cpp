#include "tests/sim/recorded.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <optional>
#include <sstream>
#include <utility>

#include "tests/sim/config.h"

namespace fxsim {
namespace {

constexpr double kMostAfterMs = 3'600'000;

std::optional<std::size_t> number_of(std::string_view text) {
  std::size_t number = 0;
  const auto [end, fault] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (fault != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return number;
}

class Reader final {
 public:
  Recording read(std::string_view text) {
    std::istringstream lines{std::string(text)};
    std::string line;
    if (!std::getline(lines, line) || line != "fxagent-recording 1")
      throw ConfigError("line 1: \"fxagent-recording 1\" is expected");
    for (line_ = 2; std::getline(lines, line); ++line_) take(line);
    return std::move(out_);
  }

 private:
  struct Place {
    std::size_t at = 0;
    std::size_t size = 0;
  };

  [[noreturn]] void wrong(const std::string& what) const {
    throw ConfigError("line " + std::to_string(line_) + ": " + what);
  }

  std::size_t number(std::istringstream& words, const std::string& what) const {
    std::string word;
    words >> word;
    const auto value = number_of(word);
    if (!value || *value > 0xFFFF) wrong(what + " must be a number");
    return *value;
  }

  void take(const std::string& line) {
    std::istringstream words(line);
    std::string key;
    words >> key;
    if (key == "link") {
      words >> out_.link;
    } else if (key == "wire") {
      std::getline(words >> std::ws, out_.wire);
    } else if (key == "number") {
      const auto device = number(words, "the device");
      const auto at = number(words, "the place");
      numbers_.resize(std::max(numbers_.size(), device + 1));
      numbers_[device] = {at, number(words, "the size")};
    } else if (!key.empty() && key.front() >= '0' && key.front() <= '9') {
      frame(words);
    }
  }

  void frame(std::istringstream& words) {
    std::string way;
    std::string device;
    std::string after;
    std::string hex;
    words >> way >> device >> after >> hex;
    if (hex.empty()) wrong("time, way, device, milliseconds and bytes are expected");
    const auto bytes = hex == "-" ? std::optional<Bytes>(Bytes()) : from_hex(hex);
    if (!bytes) wrong("the bytes must be hex digits");
    double ms = 0;
    const auto [end, fault] = std::from_chars(after.data(), after.data() + after.size(), ms);
    if (fault != std::errc() || end != after.data() + after.size() || !(ms >= 0) ||
        ms > kMostAfterMs)
      wrong("the milliseconds must be a number up to an hour");
    if (way == "out") {
      request(device, *bytes);
    } else if ((way == "in" || way == "failed") && asked_) {
      RecordedRequest& request = out_.requests[*asked_];
      request.answers.back() = {*bytes, std::chrono::milliseconds(std::llround(ms))};
      asked_.reset();
    }
  }

  void request(const std::string& device, const Bytes& bytes) {
    asked_.reset();
    if (bytes.empty()) return;
    const auto number = number_of(device);
    const Place place = number && *number < numbers_.size() ? numbers_[*number] : Place{};
    const auto known = std::ranges::find_if(out_.requests, [&](const RecordedRequest& other) {
      return other.bytes.size() == bytes.size() && other.number_at == place.at &&
             other.number_size == place.size && other.begins_with(bytes);
    });
    asked_ = static_cast<std::size_t>(known - out_.requests.begin());
    if (known == out_.requests.end()) out_.requests.push_back({bytes, place.at, place.size, {}});
    out_.requests[*asked_].answers.emplace_back();  // silence, unless an answer follows
  }

  Recording out_;
  std::size_t line_ = 1;
  std::vector<Place> numbers_;        // by device
  std::optional<std::size_t> asked_;  // request without an answer so far
};

/// Cuts a line where a recorded request ends. If one request is the beginning of another, the
/// shorter one counts.
class RecordedFramer final : public Framer {
 public:
  explicit RecordedFramer(std::shared_ptr<const Recording> recording)
      : recording_(std::move(recording)) {}

  void take(std::uint8_t byte, TimePoint when, std::vector<Frame>& out) override {
    frame_.push_back(byte);
    while (!frame_.empty()) {
      bool may_go_on = false;
      for (const RecordedRequest& request : recording_->requests) {
        if (!request.begins_with(frame_)) continue;
        may_go_on = true;
        if (request.bytes.size() != frame_.size()) continue;
        finish(true, when, out);
        return;
      }
      if (may_go_on) return;
      add_stray(frame_.front(), when, out);
      frame_.erase(frame_.begin());
    }
  }

 private:
  std::shared_ptr<const Recording> recording_;  // owned with the device
};

class RecordedDevice final : public Personality {
 public:
  explicit RecordedDevice(std::shared_ptr<const Recording> recording)
      : recording_(std::move(recording)), next_(recording_->requests.size()) {}

  Protocol protocol() const override { return Protocol::programming_port; }
  bool hears(const Frame&) const override { return true; }
  RequestKind kind(const Frame&) const override { return RequestKind::other; }
  Bytes refusal(const Frame&, std::optional<std::uint16_t>) const override { return {}; }
  void spoil(Bytes&, Flaw) const override {}
  std::unique_ptr<Framer> make_framer() const override {
    return std::make_unique<RecordedFramer>(recording_);
  }

  Ruling execute(const Frame& frame, Plc&) const override {
    Ruling ruling;
    const auto& requests = recording_->requests;
    const auto asked = std::ranges::find_if(requests, [&](const RecordedRequest& request) {
      return request.bytes.size() == frame.bytes.size() && request.begins_with(frame.bytes);
    });
    if (!frame.whole || asked == requests.end()) {
      ruling.why = "not in the recording";
      return ruling;
    }
    std::size_t& next = next_[static_cast<std::size_t>(asked - requests.begin())];
    const RecordedAnswer& answer = asked->answers[next];
    next = (next + 1) % asked->answers.size();
    if (answer.bytes.empty()) return ruling;
    ruling.verdict = Verdict::data;
    ruling.reply = answer.bytes;
    ruling.wait = answer.after;
    // The answer repeats the number of its request.
    const std::size_t end = std::min(asked->number_at + asked->number_size, ruling.reply.size());
    for (std::size_t i = asked->number_at; i < end; ++i) ruling.reply[i] = frame.bytes[i];
    return ruling;
  }

 private:
  std::shared_ptr<const Recording> recording_;  // owned with the config that named it
  mutable std::vector<std::size_t> next_;       // answer of each request; changes with each one
};

}  // namespace

bool RecordedRequest::begins_with(ByteView frame) const {
  if (frame.size() > bytes.size()) return false;
  for (std::size_t i = 0; i < frame.size(); ++i) {
    const bool is_number = i >= number_at && i - number_at < number_size;
    if (!is_number && frame[i] != bytes[i]) return false;
  }
  return true;
}

Recording parse_recording(std::string_view text) { return Reader().read(text); }

Recording read_recording(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw ConfigError(path + ": cannot be read");
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  try {
    return parse_recording(text);
  } catch (const ConfigError& error) {
    throw ConfigError(path + ": " + error.what());
  }
}

std::unique_ptr<Personality> make_recorded_device(std::shared_ptr<const Recording> recording) {
  return std::make_unique<RecordedDevice>(std::move(recording));
}

}  // namespace fxsim
