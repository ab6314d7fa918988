// The chain of audit records: each record contains the SHA-256 of the one before. Seals records and
// finds breaks in the chain. Pure functions and values, any thread. agent/commands/audit_records.h
// has the bodies of command records, audit_trail.h keeps records in the store's file, and
// agent/cli/audit/audit_report.h prints one line per command.
//
// A record is a JSON object on one line that begins {"n":17,"prev":"<64 hex digits>","kind":…}. Its
// hash covers the whole text; `prev` is the hash of the record before, 64 zeros for the first.
// Kinds:
//   answered  a command that was decided at once: its receipt and its result
//   ordered   an admitted command: its receipt. Written with the journal, before the wire
//   result    the result of an admitted command, with the frames
//   told      the broker acknowledged the result, or refused it for good
//   config    the outcome of a remote config
//   pruned    the records up to `up_to` were deleted, for their size or age
//   begun     the start of a fresh file that replaces another one
//   lost      the number of records that found no room while the disk refused
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "agent/text/sha256.h"
#include "protocol/value/bytes.h"

namespace fxagent::audit {

/// Length of the chain and hash of its last record. Stored apart from the records, and published in
/// health messages: a tail that was cut off does not match it.
struct Head {
  std::uint64_t records = 0;
  Digest hash{};
};

/// One record as stored in the file.
struct Record {
  std::uint64_t number = 0;
  std::string text;
  Bytes hash;
};

/// Returns the next record with `body`, a non-empty JSON object, and advances `head`.
Record seal(Head& head, std::string_view body);

// ---- bodies of the chain's own records ---------------------------------------------------------

/// The records up to `up_to` were deleted; `hash` is that of the last of them.
std::string pruned(std::uint64_t up_to, const Bytes& hash, std::int64_t now_ms);
std::string begun(std::string_view set_aside, std::int64_t now_ms);
std::string lost(std::uint64_t records, std::int64_t now_ms);

/// Returns the time of a record in ms UTC, or 0 if it has none.
std::int64_t time_of(std::string_view text);

// ---- verification -----------------------------------------------------------------------------

struct Finding {
  std::uint64_t record = 0;
  std::string text;
};

/// Takes the records in the order of their numbers and finds the breaks in their chain.
class Verifier final {
 public:
  /// `published`: a head noted earlier, from a health message.
  explicit Verifier(std::optional<Head> published = std::nullopt) : published_(published) {}

  void add(const Record& record);
  /// Call after the last record, with the `head` from the file. Returns the breaks; none if neither
  /// the chain nor the heads show a change.
  std::vector<Finding> finish(const Head& head);

  std::uint64_t records() const { return count_; }

 private:
  void find(std::uint64_t record, std::string text);
  void check_beginning();
  void check_published(const Head& head);

  const std::optional<Head> published_;
  std::optional<Digest> published_here_;  ///< hash of the record that it names
  std::uint64_t count_ = 0;
  std::uint64_t first_ = 0;
  std::string first_prev_;
  std::uint64_t last_ = 0;
  Bytes last_hash_;       ///< as stored next to the record
  Digest last_digest_{};  ///< computed from its text
  std::uint64_t pruned_up_to_ = 0;
  std::string pruned_hash_;
  std::vector<Finding> findings_;
};

}  // namespace fxagent::audit
