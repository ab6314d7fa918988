#include "agent/store/journal/guarded_journal.h"

#include <memory>
#include <utility>

#include "agent/without_signals.h"

namespace fxagent {

using std::chrono::steady_clock;

CommandMarker::CommandMarker(Write write) : write_(std::move(write)) {
  const WithoutSignals quiet;
  thread_ = std::jthread([this](const std::stop_token& stop) { serve(stop); });
}

void CommandMarker::mark(std::uint64_t number, Done done) {
  std::unique_lock lock(mutex_);
  if (!marks_.empty() && steady_clock::now() - began_ >= patience_) {
    lock.unlock();
    return done(false);
  }
  if (marks_.empty()) began_ = steady_clock::now();
  marks_.push_back({number, std::move(done)});
  lock.unlock();
  news_.notify_one();
}

void CommandMarker::serve(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  while (news_.wait(lock, stop, [this] { return !marks_.empty(); })) {
    const std::uint64_t number = marks_.front().number;
    lock.unlock();
    write_(number);
    lock.lock();
    const Done done = std::move(marks_.front().done);
    marks_.pop_front();
    began_ = steady_clock::now();
    lock.unlock();
    done(true);
    lock.lock();
  }
}

void GuardedJournal::note(std::string audit) {
  guard_.hangs() ? waiting_.audit.note(std::move(audit)) : journal_.note(std::move(audit));
}

bool GuardedJournal::journal(std::span<const JournalEntry> entries) {
  if (guard_.hangs()) {
    // The commands are refused, but the audit records that they came.
    for (const JournalEntry& entry : entries) note(entry.audit);
    return false;
  }
  const std::vector<JournalEntry> kept(entries.begin(), entries.end());
  return guard_.ask<bool>([this, kept] { return journal_.journal(kept); });
}

void GuardedJournal::record(std::vector<JournalEntry> entries) {
  if (!guard_.hangs()) {
    const auto kept = std::make_shared<std::vector<JournalEntry>>(std::move(entries));
    guard_.run([this, kept] { journal_.record(std::move(*kept)); });
    return;
  }
  for (JournalEntry& entry : entries) {
    note(std::exchange(entry.audit, {}));
    waiting_.results.put(std::move(entry));
  }
}

void GuardedJournal::acknowledge(std::string device, std::string id, std::uint64_t number,
                                 std::string total_ms) {
  if (!guard_.hangs())
    return journal_.acknowledge(std::move(device), std::move(id), number, std::move(total_ms));
  if (waiting_.acknowledgements.size() < UnrecordedCommands::kMost)
    waiting_.acknowledgements.emplace_back(
        [this, device = std::move(device), id = std::move(id), number,
         total_ms = std::move(total_ms)] { journal_.acknowledge(device, id, number, total_ms); });
}

std::optional<JournalEntry> GuardedJournal::find(const std::string& device, const std::string& id) {
  if (const JournalEntry* waits = waiting_.results.find(device, id)) return *waits;
  return guard_.ask<std::optional<JournalEntry>>(
      [this, device, id] { return journal_.find(device, id); });
}

std::vector<KnownId> GuardedJournal::known_ids(const std::string& device) {
  if (device.empty()) return journal_.known_ids();
  return guard_.ask<std::vector<KnownId>>([this, device] { return journal_.known_ids(device); });
}

std::vector<JournalEntry> GuardedJournal::unacknowledged(const std::string& device) {
  if (device.empty()) return journal_.unacknowledged();
  return guard_.ask<std::vector<JournalEntry>>(
      [this, device] { return journal_.unacknowledged(device); });
}

void GuardedJournal::take_up(DiskGuard::Work before) {
  const auto waiting = std::make_shared<Waiting>(std::exchange(waiting_, {}));
  for (std::string& body : waiting->audit.bodies) audit_.note(std::move(body));
  audit_.lose(waiting->audit.lost);
  // An acknowledgement must follow its result.
  const auto acknowledge = [waiting] {
    for (const auto& each : waiting->acknowledgements) each();
  };
  const bool done = guard_.run(
      [this, waiting, before = std::move(before)] {
        before();
        journal_.record({waiting->results.begin(), waiting->results.end()});
      },
      acknowledge);
  if (done) acknowledge();
}

}  // namespace fxagent
