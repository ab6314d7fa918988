// The store on disk: samples that were not acknowledged, the journal of commands, the audit trail,
// and the numbers that each device has reached. One SQLite file, fxagent.db, in a directory of its
// own. Uplink thread; before that thread is started, the thread that made it.
//
// No failure of the disk is a failure of the caller: what could not be written is the caller's to
// keep, the state becomes `memory`, and upkeep() tries again now and then.
#pragma once

#include <boost/multi_index/composite_key.hpp>
#include <boost/multi_index/member.hpp>
#include <boost/multi_index/ordered_index.hpp>
#include <boost/multi_index/sequenced_index.hpp>
#include <boost/multi_index_container.hpp>
#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "agent/commands/journal.h"
#include "agent/config/config.h"
#include "agent/messages.h"
#include "agent/store/audit_chain.h"
#include "agent/store/history.h"
#include "agent/store/store_file.h"

namespace fxagent {

class Store final : public CommandJournal {
 public:
  /// Whether rows are on their way as live messages, so that no history message may take them yet.
  enum class Hold : std::uint8_t { no, yes };
  /// What is written of the numbers: how far a boot may count without asking again.
  static constexpr std::uint64_t kSequenceBlock = 10000;
  /// Behind the last number that the disk knows, where it refused and nobody knows how many
  /// followed.
  static constexpr std::uint64_t kUnknownNumbers = 1000000;
  static constexpr std::chrono::seconds kTryAgain{10};
  /// Of the calendar against the steady clock: so much more than either drifts is a set clock.
  static constexpr std::chrono::seconds kClockSet{60};

  /// Opens or makes the file in `config.path`, and the directory. A damaged file is set aside as
  /// fxagent.db.corrupt-<utc_ms>. Never throws on what the disk does: see state().
  Store(const StoreConfig& config, std::int64_t utc_ms);
  ~Store() override;
  Store(const Store&) = delete;
  Store& operator=(const Store&) = delete;

  bool is_writable() const { return writable_; }
  /// "disk", or "memory" where nothing can be written.
  std::string_view state() const { return writable_ ? "disk" : "memory"; }
  /// Tries again to write where that failed, deletes what was acknowledged, lets go what is older
  /// than max_age and ids that need not be remembered any more. Ages are those of the time on disk,
  /// and a clock that is set meanwhile makes nothing older or younger. Files that were deleted or
  /// replaced since are noticed within a minute: what was in them counts as dropped, and those that
  /// are there now are opened, or made. Cheap where nothing is due.
  void upkeep(SteadyTime now, std::int64_t utc_ms);

  /// Whether upkeep() has something to write soon.
  bool has_pending() const { return writable_ && (owes_the_file() || numbers_short_); }
  /// The name of the damaged file that was set aside in this run; empty: none was.
  const std::string& set_aside() const { return set_aside_; }

  // ---- samples

  /// All of them in one transaction that is synchronised with the disk, and then the oldest rows
  /// out until max_bytes holds, the commands counted. Each row gets its `row_id`. False: none was
  /// written, and none changed.
  bool append(std::vector<SampleRow>& rows, Hold hold);
  /// The next history message, as Backlog::next() has it. Rows that are damaged are dropped and
  /// counted: one of them would spoil the whole message.
  std::optional<HistoryBatch> next(std::size_t max_payload, const MaySend& may_send);
  /// The rows are delivered, or will never be. Returns how many were still here: one that had to
  /// make room was counted as dropped already.
  std::uint64_t remove(std::span<const std::uint64_t> row_ids);
  std::uint64_t remove(const HistoryBatch& batch);
  /// The batch did not arrive: its rows wait again.
  void returned(const HistoryBatch& batch);
  /// A held row did not arrive: it waits for a history message.
  void release(std::uint64_t row_id);

  std::uint64_t rows() const { return rows_; }
  /// Of samples, and of what is kept of commands: together they stay below max_bytes().
  std::uint64_t bytes() const { return bytes_ + journal_size_.bytes; }
  std::uint64_t max_bytes() const { return config_.max_bytes; }
  std::uint64_t recovered() const { return recovered_; }  ///< rows found at the start
  bool has_waiting(const std::string& device) const;
  bool has_waiting(const StreamKey& stream) const;
  bool is_on_the_way(const StreamKey& stream) const;
  /// Rows that had to make room, were too old or lay in a damaged file, since the last call.
  std::map<std::string, std::uint64_t> take_dropped() { return std::exchange(dropped_, {}); }

  // ---- numbers

  /// For each of these devices the number before its first sample in this boot. After a clean
  /// stop, and with `sync: always`, the last one used; after a crash, and where the disk refused,
  /// one above all that may have been used. Once, at the start.
  std::vector<std::uint64_t> begin_numbers(std::span<const std::string> devices,
                                           std::int64_t utc_ms);
  /// To be called before a sample with this number leaves the agent.
  void used_seq(const std::string& device, std::uint64_t seq);
  /// The clean end: the next boot goes on right behind the numbers used, and the file is closed up.
  void close();

  // ---- the journal of commands

  bool journal(std::span<const JournalEntry> entries) override;
  void record(JournalEntry entry) override;
  void record(std::vector<JournalEntry> entries) override;
  void acknowledge(std::string device, std::string id, std::uint64_t number) override;
  std::optional<JournalEntry> find(const std::string& device, const std::string& id) override;
  std::vector<KnownId> known_ids() override;
  std::vector<JournalEntry> unacknowledged() override;

  /// What earlier runs left in a file that could not be opened at the start of this one.
  struct FoundLate {
    std::vector<KnownId> ids;                      ///< as known_ids()
    std::vector<JournalEntry> unacknowledged;      ///< as unacknowledged()
    std::map<std::string, std::uint64_t> numbers;  ///< by device; only those above this run's
  };
  /// Once after such a file has opened: until then none of its ids was known.
  std::optional<FoundLate> take_found_late() { return std::exchange(found_late_, std::nullopt); }

  // ---- the audit

  /// The number of a command that has just come.
  std::uint64_t next_command_number() override { return ++last_command_number_; }
  /// A record's body for the audit, written within 200 ms, or once the disk takes it.
  void note(std::string body) override;
  /// As it is in the file.
  audit::Head audit_head() const { return file_ ? file_->trail.head() : audit::Head{}; }

 private:
  struct Stream {
    std::uint64_t rows = 0;  ///< in the file
    std::uint64_t out = 0;   ///< of these, held or on the way
    bool on_the_way = false;
    std::uint64_t oldest = 0;  ///< no row of it has a lower id
  };
  struct Out {
    StreamKey stream;
    std::uint64_t cost = 0;
  };
  struct Numbers {
    std::uint64_t last = 0;      ///< used
    std::uint64_t reserved = 0;  ///< up to here without asking
  };
  struct NumberRow {
    std::string device;
    std::uint64_t last = 0;
  };
  struct Acknowledgement {
    std::string device;
    std::string id;
    std::uint64_t number = 0;
  };
  /// What the file has of commands.
  struct JournalSize {
    std::uint64_t rows = 0;
    std::uint64_t bytes = 0;
    std::uint64_t refused = 0;
  };
  struct Victim {
    std::uint64_t row_id = 0;
    StreamKey stream;
    std::uint64_t cost = 0;
  };

  /// In the order in which they came, and last changed, and one for each device and id.
  using Unrecorded = boost::multi_index_container<
      JournalEntry,
      boost::multi_index::indexed_by<
          boost::multi_index::sequenced<>,
          boost::multi_index::ordered_unique<boost::multi_index::composite_key<
              JournalEntry,
              boost::multi_index::member<JournalEntry, std::string, &JournalEntry::device>,
              boost::multi_index::member<JournalEntry, std::string, &JournalEntry::id>>>>>;

  void open(std::int64_t utc_ms);
  bool load();
  /// Whether flush() has something to write.
  bool owes_the_file() const {
    return !(removed_.empty() && to_acknowledge_.empty() && unrecorded_.empty() &&
             unaudited_.empty()) ||
           audit_lost_ != 0;
  }
  void forget_rows();
  void open_late(std::int64_t utc_ms);
  void look_for_the_files();
  void start_anew(std::string why);
  void failed(std::string_view doing);
  /// A single row could not be read. The file can be written all the same, unless it is damaged.
  void unreadable();
  /// Rows that were removed, results that were acknowledged and those that found no disk, into the
  /// file.
  bool flush();
  /// Within the caller's transaction; flushed() after its commit.
  bool write_pending();
  void flushed();
  bool flush_piece();
  bool flush_all();
  /// Deletes the oldest rows, `excess` bytes or what is older, within the caller's transaction.
  bool delete_oldest(std::uint64_t excess, std::int64_t older_than_ms, std::vector<Victim>& gone);
  void forget(const std::vector<Victim>& gone);
  void drop_damaged(const StreamKey& stream, const std::vector<std::uint64_t>& row_ids);
  void drop_old_rows();
  /// The oldest rows out of what is above max_bytes, the commands counted.
  void drop_excess_rows();
  void drop_rows(std::uint64_t excess, std::int64_t older_than_ms);
  void drop_old_ids();
  bool measure_journal();
  /// Carries out a change of one row within the caller's transaction and counts what it does.
  bool change_command(const std::string& device, const std::string& id,
                      const std::function<bool()>& change);
  bool make_room_for_refused();
  void shrink_journal();
  bool write_commands(std::span<const JournalEntry> entries);
  bool write_command(const JournalEntry& entry);
  bool write_entry(const JournalEntry& entry);
  bool write_record(const JournalEntry& entry);
  void keep_unrecorded(JournalEntry entry);
  void begin_changes();
  /// Within the caller's transaction, after the trail's begin().
  bool write_audit(std::string_view body);
  bool write_unaudited();
  bool commit(sqlite::Transaction& transaction);
  void prune_audit();
  bool write_numbers(const std::vector<NumberRow>& rows, bool clean);
  void write_all_numbers();
  void reserve_numbers();
  void note_clock(SteadyTime now, std::int64_t utc_ms);
  void restamp();
  std::string numbers_behind_path() const;
  void numbers_are_behind();
  void numbers_are_known();

  const StoreConfig config_;
  std::unique_ptr<DirectoryLock> lock_;
  std::unique_ptr<StoreFile> file_;  ///< null: it could not be opened
  bool writable_ = false;
  std::string last_failure_;
  std::int64_t utc_ms_ = 0;             ///< of the last upkeep
  std::optional<SteadyTime> clock_at_;  ///< the same moment
  std::uint64_t first_command_of_run_ = 0;
  std::int64_t unstamped_ms_ = 0;   ///< what the clock was set by, not yet written to the file
  std::uint64_t first_of_run_ = 0;  ///< the id of the first row of this run
  std::string set_aside_;
  std::optional<SteadyTime> try_at_;
  std::optional<SteadyTime> flush_at_;
  std::optional<SteadyTime> clean_up_at_;

  std::uint64_t next_row_id_ = 1;
  std::uint64_t rows_ = 0;
  std::uint64_t bytes_ = 0;
  std::uint64_t recovered_ = 0;
  std::map<StreamKey, Stream> streams_;
  std::unordered_map<std::uint64_t, Out> out_;
  JournalSize journal_size_;            ///< as committed
  JournalSize journal_size_changed_;    ///< as the transaction that is open will leave it
  std::uint64_t not_to_be_shrunk_ = 0;  ///< bytes of commands that nothing could be taken from
  std::set<std::uint64_t> removed_;     ///< still in the file
  std::map<std::string, std::uint64_t> dropped_;
  Unrecorded unrecorded_;  ///< commands and results that are not in the file
  std::size_t unrecorded_bytes_ = 0;
  std::vector<Acknowledgement> to_acknowledge_;  ///< by the broker, not noted yet
  bool forgot_results_ = false;                  ///< there were too many of them
  std::optional<FoundLate> found_late_;
  bool was_open_ = false;              ///< in this run
  bool mending_ = false;               ///< a fresh file is being made in place of a damaged one
  std::deque<std::string> unaudited_;  ///< bodies that are not in the file
  std::size_t unaudited_bytes_ = 0;
  std::uint64_t audit_lost_ = 0;  ///< bodies that found no room there, not reported yet
  std::uint64_t last_command_number_ = 0;
  std::uint64_t first_audit_of_run_ = 0;
  std::optional<SteadyTime> running_since_;
  std::optional<SteadyTime> prune_at_;
  std::map<std::string, Numbers> numbers_;
  bool numbers_short_ = false;   ///< some device has used half of its block
  bool numbers_behind_ = false;  ///< a mark beside the file says that it does not know them all
};

}  // namespace fxagent
