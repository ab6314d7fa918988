// The chain of audit records, each tied to the one before by its SHA-256: how it is tied, and how a
// break is found. Pure functions and values, any thread. agent/commands/audit_records.h says what
// records of commands hold, audit_trail.h keeps them in the store's file, and
// agent/cli/audit_report.h makes one line a command of them.
//
// A record is a JSON object in one line that begins {"n":17,"prev":"<64 hex digits>","kind":…}.
// Its hash is that of the whole text; `prev` is the hash of the record before, 64 zeros for the
// first. Kinds:
//   answered  a command that was decided at once: how it came, and its result
//   ordered   an admitted one: how it came. Written with the journal, before the wire
//   result    of an admitted one, with the frames
//   told      the broker has acknowledged the result, or refuses it for good
//   pruned    the records up to `up_to` were let go, for their size or age
//   begun     a fresh file, after a damaged one was set aside
//   lost      so many records found no room while the disk refused
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "agent/messages.h"
#include "agent/sha256.h"
#include "protocol/bytes.h"

namespace fxagent::audit {

/// How long the chain is, and the hash of its last record. Kept apart from the records, and
/// published: with it a tail that was cut off is found.
struct Head {
  std::uint64_t records = 0;
  Digest hash{};
};

/// One record as it lies in the file.
struct Record {
  std::uint64_t number = 0;
  std::string text;
  Bytes hash;
};

/// The next record, with `body`, a JSON object that is not empty. Moves `head` on.
Record seal(Head& head, std::string_view body);

// ---- bodies of the chain's own records ---------------------------------------------------------

/// The records before this one were let go; `hash` is that of the last of them.
std::string pruned(std::uint64_t up_to, const Bytes& hash, std::int64_t now_ms);
std::string begun(std::string_view set_aside, std::int64_t now_ms);
std::string lost(std::uint64_t records, std::int64_t now_ms);

/// The time of a record; 0 where it says none.
std::int64_t time_of(std::string_view text);

// ---- whether they are whole -------------------------------------------------------------------

struct Finding {
  std::uint64_t record = 0;
  std::string text;
};

/// Takes the records in the order of their numbers and says where the chain is broken.
class Verifier final {
 public:
  /// `published`: a head that somebody has noted earlier, from a health message.
  explicit Verifier(std::optional<Head> published = std::nullopt) : published_(published) {}

  void add(const Record& record);
  /// After the last one; `head` as the file has it. Empty: nothing was changed, as far as the chain
  /// and the heads can tell.
  std::vector<Finding> finish(const Head& head);

  std::uint64_t records() const { return count_; }

 private:
  void find(std::uint64_t record, std::string text);
  void check_beginning();
  void check_published(const Head& head);

  const std::optional<Head> published_;
  std::optional<Digest> published_here_;  ///< the hash of the record that it names
  std::uint64_t count_ = 0;
  std::uint64_t first_ = 0;
  std::string first_prev_;
  std::uint64_t last_ = 0;
  Bytes last_hash_;       ///< as it is kept beside the record
  Digest last_digest_{};  ///< of its text
  std::uint64_t pruned_up_to_ = 0;
  std::string pruned_hash_;
  std::vector<Finding> findings_;
};

}  // namespace fxagent::audit
