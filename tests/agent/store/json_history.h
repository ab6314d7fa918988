// Rows that have only a number, and a history message that has the numbers of its rows.
#pragma once

#include <optional>
#include <string>

#include "agent/store/samples/backlog.h"
#include "agent/store/samples/history.h"

namespace fxagent::test {

/// Returns the content of a row without tags.
inline std::string row_content(std::uint64_t seq, const std::string& boot = {}) {
  Telemetry message;
  message.seq = seq;
  return encode_sample(message, DeviceConfig(), boot, {});
}
/// Bytes of a row's content, without a boot and with a `seq` below 24.
inline constexpr std::size_t kRowBytes = 7;

class JsonHistory final : public HistoryMessage {
 public:
  explicit JsonHistory(std::size_t max_bytes) : max_bytes_(max_bytes) {}

  bool add(const SampleRecord& sample) override {
    std::string longer = text_ + (is_empty_ ? "" : ",") + std::to_string(sample.seq);
    if (!is_empty_ && longer.size() + 2 > max_bytes_) return false;
    text_ = std::move(longer);
    is_empty_ = false;
    return true;
  }
  std::string text() const { return text_ + "]}"; }

 private:
  const std::size_t max_bytes_;
  bool is_empty_ = true;
  std::string text_ = R"({"history":true,"rows":[)";
};

/// A history message with its text.
struct Batch : HistoryBatch {
  std::string payload;
};

/// Returns the next message of a backlog, of at most this many bytes.
inline std::optional<Batch> next(Backlog& backlog, std::size_t max_bytes, const MaySend& may_send) {
  JsonHistory message(max_bytes);
  const auto batch = backlog.next(message, may_send);
  if (!batch) return std::nullopt;
  return Batch{*batch, message.text()};
}

}  // namespace fxagent::test
