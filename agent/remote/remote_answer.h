// The answer for {base}/config/reported: its state, its pending publication, and the document that
// was rejected last. One thread.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "agent/remote/kept_configs.h"
#include "agent/remote/remote_report.h"

namespace fxagent {

class RemoteAnswer final {
 public:
  using State = RemoteReport::State;

  /// Begins with the local file alone, in force since `since_ms` UTC.
  void begin(std::int64_t since_ms) { report_.since_ms = since_ms; }
  /// Restores the answer of the last run. It is not news.
  void resume(const KeptConfigs& kept);

  /// Sets the answer, which must then be published. It is news if it differs from the last one.
  void report(State state, const DesiredConfig& desired, const ConfigErrors& errors,
              std::int64_t since_ms);
  /// Reports the document in force, or else the local file alone.
  void report_in_force(const std::optional<KeptConfig>& in_force, std::int64_t local_since_ms);
  void report_rolled_back(const RolledBackConfig& back);
  /// Reports the errors and keeps `payload` for rejected(), unless it is too large for a document.
  void reject(std::string_view payload, const DesiredConfig& desired, const ConfigErrors& errors,
              std::int64_t now_ms);
  /// Repeats the answer to a document that is in force or was rolled back. The broker sends it
  /// again after each connection. Returns false if the document is neither.
  bool repeat(const DesiredConfig& desired, const std::optional<KeptConfig>& in_force,
              const std::optional<RolledBackConfig>& back);

  /// Requests another publication of the same answer.
  void publish_again() { has_answer_ = true; }
  void clear_news() { is_news_ = false; }
  void clear_rejected() { rejected_.clear(); }

  const RemoteReport& last() const { return report_; }
  const std::string& rejected() const { return rejected_; }
  bool has_answer() const { return has_answer_; }
  bool is_news() const { return is_news_; }
  /// Call when the answer is published. True if it differs from the previous one.
  bool take_news() {
    has_answer_ = false;
    return std::exchange(is_news_, false);
  }

 private:
  RemoteReport report_;
  std::string rejected_;
  bool has_answer_ = false;
  bool is_news_ = false;
};

}  // namespace fxagent
