#include "agent/store/guarded_store.h"

#include <algorithm>
#include <utility>

#include "agent/log/log.h"

namespace fxagent {

GuardedStore::Figures GuardedStore::look() const {
  return {store_.samples().rows(), store_.samples().recovered(), store_.bytes(), store_.set_aside(),
          store_.audit().head()};
}

/// Returns false if the work is overdue. upkeep() then calls `late` after it has ended.
bool GuardedStore::run(DiskThread::Work work, std::function<void()> late) {
  // Overdue work hides what the store has dropped so far, and `seen_` no longer has it.
  collect_dropped();
  seen_ = look();
  if (thread_.run(std::move(work))) return true;
  hangs_ = true;
  late_ = std::move(late);
  log::error("store", {{"state", "hangs"},
                       {"path", store_.path()},
                       {"note",
                        "the disk does not respond: until it does, samples wait in memory and the "
                        "agent refuses commands that write"}});
  return false;
}

template <class Result>
Result GuardedStore::ask(std::function<Result()> question) {
  if (hangs_) return {};
  const auto answer = std::make_shared<Result>();
  if (!run([answer, question = std::move(question)] { *answer = question(); })) return {};
  return std::move(*answer);
}

void GuardedStore::upkeep(SteadyTime now, std::int64_t utc_ms) {
  if (hangs_ && !thread_.is_busy()) take_up(utc_ms);
  if (hangs_ || !store_.note_time(now, utc_ms)) return;
  run([this, now, utc_ms] { store_.upkeep(now, utc_ms); });
}

/// The disk has answered. The outcome of the overdue work goes first, then the notes in their
/// order: an acknowledgement must follow its result.
void GuardedStore::take_up(std::int64_t utc_ms) {
  hangs_ = false;
  samples_at_disk_ = 0;
  streams_at_disk_.clear();
  log::info("store", {{"state", std::string(store_.state())}, {"note", "the disk responds again"}});
  if (const auto late = std::exchange(late_, {})) late();
  const auto waiting = std::make_shared<Waiting>(std::exchange(waiting_, {}));
  for (const auto& change : waiting->samples) change();
  for (std::string& body : waiting->audit) store_.audit().note(std::move(body));
  store_.audit().lose(waiting->audit_lost);
  const auto acknowledge = [waiting] {
    for (const auto& each : waiting->acknowledgements) each();
  };
  const bool done = run(
      [this, waiting, utc_ms] {
        store_.numbers().join(waiting->joined, utc_ms);
        for (const auto& [device, seq] : waiting->used) store_.numbers().used(device, seq);
        store_.journal().record({waiting->results.begin(), waiting->results.end()});
      },
      acknowledge);
  if (done) acknowledge();
}

std::optional<Store::FoundLate> GuardedStore::take_found_late() {
  return hangs_ ? std::nullopt : store_.take_found_late();
}

void GuardedStore::close() {
  if (!hangs_) run([this] { store_.close(); });
}

// ---- samples ------------------------------------------------------------------------------------

void GuardedStore::append(std::vector<SampleRow> rows, Stored then) {
  if (hangs_ || rows.empty()) return then(std::move(rows), false);
  struct Call {
    std::vector<SampleRow> rows;
    bool on_disk = false;
  };
  const auto call = std::make_shared<Call>(Call{std::move(rows)});
  std::set<StreamKey> streams;
  for (const SampleRow& row : call->rows) streams.emplace(row.device, row.group);
  const std::size_t count = call->rows.size();
  const auto end = [call, then = std::move(then)] { then(std::move(call->rows), call->on_disk); };
  const bool in_time = run(
      [this, call] { call->on_disk = store_.samples().append(call->rows, Store::Hold::no); }, end);
  if (in_time) return end();
  samples_at_disk_ = count;
  streams_at_disk_ = std::move(streams);
}

bool GuardedStore::hold(std::vector<SampleRow>& rows) {
  if (hangs_ || rows.empty()) return false;
  struct Call {
    std::vector<SampleRow> rows;
    bool on_disk = false;
  };
  const auto call = std::make_shared<Call>(Call{rows});
  const bool in_time =
      run([this, call] { call->on_disk = store_.samples().append(call->rows, Store::Hold::yes); },
          [this, call] {
            // The caller treats them as not stored.
            if (!call->on_disk) return;
            for (const SampleRow& row : call->rows)
              store_.samples().remove(std::span(&row.row_id, 1));
          });
  if (!in_time || !call->on_disk) return false;
  rows = std::move(call->rows);
  return true;
}

std::optional<HistoryBatch> GuardedStore::next(std::shared_ptr<HistoryMessage> message,
                                               const MaySend& may_send) {
  while (!hangs_) {
    const auto stream = store_.samples().next_stream(may_send);
    if (!stream) return std::nullopt;
    const auto batch = std::make_shared<std::optional<HistoryBatch>>();
    const bool in_time = run(
        [this, message, stream, batch] {
          const auto is_it = [&stream](const StreamKey& each) { return each == *stream; };
          *batch = store_.samples().next(*message, is_it);
        },
        [this, batch] {
          if (*batch) store_.samples().returned(**batch);
        });
    if (!in_time) return std::nullopt;
    if (*batch) return std::move(*batch);
    // If all rows of the stream were damaged, they are gone now: try the next stream.
    if (store_.samples().next_stream(may_send) == stream) return std::nullopt;
  }
  return std::nullopt;
}

void GuardedStore::returned(const HistoryBatch& batch) {
  if (!hangs_) return store_.samples().returned(batch);
  waiting_.samples.emplace_back([this, batch] { store_.samples().returned(batch); });
}

void GuardedStore::release(std::uint64_t row_id) {
  if (!hangs_) return store_.samples().release(row_id);
  waiting_.samples.emplace_back([this, row_id] { store_.samples().release(row_id); });
}

void GuardedStore::remove(const HistoryBatch& batch, Removed then) {
  if (!hangs_) return then(store_.samples().remove(batch));
  waiting_.samples.emplace_back(
      [this, batch, then = std::move(then)] { then(store_.samples().remove(batch)); });
}

void GuardedStore::remove(std::uint64_t row_id, Removed then) {
  if (!hangs_) return then(store_.samples().remove(std::span(&row_id, 1)));
  waiting_.samples.emplace_back([this, row_id, then = std::move(then)] {
    then(store_.samples().remove(std::span(&row_id, 1)));
  });
}

bool GuardedStore::has_waiting(const std::string& device) const {
  return !hangs_ && store_.samples().has_waiting(device);
}

bool GuardedStore::is_ahead_of_memory(const StreamKey& stream) const {
  if (hangs_) return seen_.rows > 0 || streams_at_disk_.contains(stream);
  return store_.samples().has_waiting(stream) || store_.samples().is_on_the_way(stream);
}

std::map<std::string, std::uint64_t> GuardedStore::take_dropped() {
  if (!hangs_) collect_dropped();
  return std::exchange(dropped_, {});
}

void GuardedStore::collect_dropped() {
  for (const auto& [device, count] : store_.samples().take_dropped()) dropped_[device] += count;
}

// ---- numbers ------------------------------------------------------------------------------------

void GuardedStore::used(const std::string& device, std::uint64_t seq) {
  if (hangs_) {
    std::uint64_t& last = waiting_.used[device];
    last = std::max(last, seq);
  } else if (store_.numbers().asks_disk(device, seq)) {
    run([this, device, seq] { store_.numbers().used(device, seq); });
  } else {
    store_.numbers().used(device, seq);
  }
}

std::vector<std::uint64_t> GuardedStore::join(const std::vector<std::string>& devices,
                                              std::int64_t utc_ms) {
  if (hangs_) waiting_.joined.insert(waiting_.joined.end(), devices.begin(), devices.end());
  auto last = ask<std::vector<std::uint64_t>>(
      [this, devices, utc_ms] { return store_.numbers().join(devices, utc_ms); });
  // If the store hangs, start at the clock: it is above every number of an earlier boot.
  last.resize(devices.size(), static_cast<std::uint64_t>(utc_ms));
  return last;
}

// ---- the journal --------------------------------------------------------------------------------

void GuardedStore::note(std::string audit) {
  if (!hangs_) return store_.journal().note(std::move(audit));
  if (audit.empty()) return;
  if (waiting_.audit.size() >= AuditTrail::kMostWaiting ||
      waiting_.audit_bytes >= AuditTrail::kMostWaitingBytes) {
    ++waiting_.audit_lost;
    return;
  }
  waiting_.audit_bytes += audit.size();
  waiting_.audit.push_back(std::move(audit));
}

bool GuardedStore::journal(std::span<const JournalEntry> entries) {
  if (hangs_) {
    // The commands are refused, but the audit records that they came.
    for (const JournalEntry& entry : entries) note(entry.audit);
    return false;
  }
  const std::vector<JournalEntry> kept(entries.begin(), entries.end());
  return ask<bool>([this, kept] { return store_.journal().journal(kept); });
}

void GuardedStore::record(JournalEntry entry) {
  std::vector<JournalEntry> entries;
  entries.push_back(std::move(entry));
  record(std::move(entries));
}

void GuardedStore::record(std::vector<JournalEntry> entries) {
  if (!hangs_) {
    const auto kept = std::make_shared<std::vector<JournalEntry>>(std::move(entries));
    run([this, kept] { store_.journal().record(std::move(*kept)); });
    return;
  }
  for (JournalEntry& entry : entries) {
    note(std::exchange(entry.audit, {}));
    waiting_.results.put(std::move(entry));
  }
}

void GuardedStore::acknowledge(std::string device, std::string id, std::uint64_t number,
                               std::string total_ms) {
  if (!hangs_)
    return store_.journal().acknowledge(std::move(device), std::move(id), number,
                                        std::move(total_ms));
  if (waiting_.acknowledgements.size() < UnrecordedCommands::kMost)
    waiting_.acknowledgements.emplace_back([this, device = std::move(device), id = std::move(id),
                                            number, total_ms = std::move(total_ms)] {
      store_.journal().acknowledge(device, id, number, total_ms);
    });
}

std::optional<JournalEntry> GuardedStore::find(const std::string& device, const std::string& id) {
  if (const JournalEntry* waits = waiting_.results.find(device, id)) return *waits;
  return ask<std::optional<JournalEntry>>(
      [this, device, id] { return store_.journal().find(device, id); });
}

std::vector<KnownId> GuardedStore::known_ids_of(const std::string& device) {
  return ask<std::vector<KnownId>>(
      [this, device] { return store_.journal().known_ids_of(device); });
}

std::vector<JournalEntry> GuardedStore::unacknowledged_of(const std::string& device) {
  return ask<std::vector<JournalEntry>>(
      [this, device] { return store_.journal().unacknowledged_of(device); });
}

}  // namespace fxagent
