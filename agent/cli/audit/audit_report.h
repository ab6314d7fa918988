// Audit records for people and programs: merges the records of one command into one line. Pure.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "agent/store/audit_chain.h"

namespace fxagent::audit {

/// One command, or an event of the audit itself.
struct Line {
  std::int64_t at_ms = 0;  ///< when the command arrived, if the records still show it
  std::string json;        ///< one JSON object, without a newline
  std::string text;        ///< human-readable, without a newline
};

class Report final {
 public:
  /// Call in the order of record numbers.
  void add(const Record& record);
  /// Returns the lines in order of arrival of the commands, if their records are still present.
  std::vector<Line> take();

 private:
  struct Pieces {
    std::string came;
    std::string outcome;
    std::string told;
    std::vector<std::uint64_t> records;
  };
  std::map<std::uint64_t, Pieces> commands_;
  std::vector<Line> notes_;
};

/// Parses `--since`: milliseconds UTC; "2026-11-21", "2026-11-21T08:30" or "…:15Z", also UTC; or a
/// duration before `now_ms`: "90s", "30m", "2h", "7d". Returns nullopt for any other text.
std::optional<std::int64_t> since_from(std::string_view text, std::int64_t now_ms);

}  // namespace fxagent::audit
