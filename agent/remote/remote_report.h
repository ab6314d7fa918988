// Answers on {base}/config/reported. Pure; functions on any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "agent/config/config_error.h"
#include "agent/remote/desired_config.h"
#include "agent/remote/kept_configs.h"

namespace fxagent {

struct RemoteReport {
  enum class State : std::uint8_t { applied, rejected, rolled_back };
  State state = State::applied;
  DesiredConfig desired{};  ///< without its text; an empty hash means the local file alone
  ConfigErrors errors{};    ///< those reported, at most kMostReportedErrors
  std::size_t errors_in_all = 0;
  std::int64_t since_ms = 0;

  /// True if both reports are equal, ignoring `since_ms`.
  bool says(const RemoteReport& other) const;
};
std::string_view to_string(RemoteReport::State state);

/// Limits of a report: number of errors, bytes of each, and bytes of all errors as JSON text.
inline constexpr std::size_t kMostReportedErrors = 1000;
inline constexpr std::size_t kMostErrorBytes = 1024;
inline constexpr std::size_t kMostReportedBytes = 48 * 1024;

/// Returns a report with the errors within these limits; at least the first one.
RemoteReport make_report(RemoteReport::State state, DesiredConfig desired,
                         const ConfigErrors& errors, std::int64_t since_ms);

/// Returns the payload for {base}/config/reported. `hash` is that of the config in force.
/// `in_force` is the version of the remote config in it, empty if there is none.
std::string reported_text(const RemoteReport& report, const std::string& hash,
                          const std::string& in_force, bool is_confirmed);

/// The answer: its state, its pending publication, and the last rejected document. One thread.
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
  void publish_again() { is_due_ = true; }
  void clear_news() { is_news_ = false; }
  void clear_rejected() { rejected_.clear(); }

  const RemoteReport& last() const { return report_; }
  /// Returns the last rejected document; empty if there is none.
  const std::string& rejected() const { return rejected_; }
  /// True if the answer must be published, again or for the first time.
  bool is_due() const { return is_due_; }
  bool is_news() const { return is_news_; }
  /// Call when the answer is published. True if it differs from the previous one.
  bool take_news() {
    is_due_ = false;
    return std::exchange(is_news_, false);
  }

 private:
  RemoteReport report_;
  std::string rejected_;
  bool is_due_ = false;
  bool is_news_ = false;
};

}  // namespace fxagent
