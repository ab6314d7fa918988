// What the audit says for people and programs: the records of one command become one line. Pure.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "agent/store/audit_chain.h"

namespace fxagent::audit {

/// One command; or, with `number` 0, something that happened to the audit itself.
struct Line {
  std::uint64_t number = 0;
  std::int64_t at_ms = 0;  ///< when the command came, as far as that is known still
  std::string json;        ///< one object, without a newline
  std::string text;        ///< for people, without a newline
};

class Report final {
 public:
  /// In the order of their numbers.
  void add(const Record& record);
  /// In the order in which the commands came, as far as records of them are left.
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

/// Reads `--since`: milliseconds UTC; "2026-11-21", "2026-11-21T08:30" or "…:15Z", UTC too; or a
/// duration before `now_ms`: "90s", "30m", "2h", "7d". Nothing: it is none of these.
std::optional<std::int64_t> since_from(std::string_view text, std::int64_t now_ms);

}  // namespace fxagent::audit
