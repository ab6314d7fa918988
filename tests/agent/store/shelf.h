// A store in its own directory, and functions that fill it.
#pragma once

#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <span>

#include "agent/commands/audit_records.h"
#include "agent/store/store.h"
#include "tests/agent/store/json_history.h"
#include "tests/support/disk_limit.h"
#include "tests/support/scratch.h"

namespace fxagent::test {

inline constexpr std::int64_t kNow = 1790000000000;
inline const SteadyTime kStart{std::chrono::hours(1)};

inline std::vector<SampleRow> rows(std::uint64_t from, std::uint64_t to,
                                   const std::string& device = "a",
                                   const std::string& group = "fast") {
  std::vector<SampleRow> made;
  for (std::uint64_t seq = from; seq <= to; ++seq)
    made.push_back({0, {device, group}, seq, row_content(seq)});
  return made;
}

inline bool any(const StreamKey&) { return true; }

/// Returns the next message of the samples on disk, of at most this many bytes.
inline std::optional<Batch> next(StoredSamples& samples, std::size_t max_bytes,
                                 const MaySend& may_send) {
  for (std::optional<StreamKey> before;;) {
    const auto stream = samples.streams().oldest_waiting(may_send);
    if (!stream || stream == before) return std::nullopt;
    JsonHistory message(max_bytes);
    if (auto batch = samples.next(*stream, message)) return Batch{*batch, message.text()};
    before = stream;
  }
}

inline JournalEntry entry(std::string id, std::string result = {},
                          std::int64_t received_ms = kNow) {
  JournalEntry made;
  made.device = "a";
  made.id = std::move(id);
  made.received_ms = received_ms;
  made.deadline_ms = received_ms + 10000;
  made.op = "write";
  made.response_topic = "hmi/replies";
  made.correlation = {1, 0, 255};
  made.result = std::move(result);
  return made;
}

/// A store in its own directory, opened as often as needed.
struct Shelf {
  Scratch scratch;
  StoreConfig config;
  std::unique_ptr<Store> store;

  Shelf() { config.path = scratch.path("store"); }
  Store& open(std::int64_t utc_ms = kNow) {
    store.reset();
    store = std::make_unique<Store>(config, utc_ms);
    return *store;
  }
  /// Puts a file at the store's path, so that it cannot be opened.
  void block() const { std::ofstream(config.path) << "a file in its place"; }
  /// Closes the store. Until mount(), its directory is missing, as with a disk that comes late.
  void unmount() {
    store.reset();
    std::filesystem::rename(config.path, config.path + "-away");
    block();
  }
  void mount() const {
    std::filesystem::remove(config.path);
    std::filesystem::rename(config.path + "-away", config.path);
  }
  std::string file() const { return config.path + "/fxagent.db"; }
  /// Returns the number before device a's first one in this boot.
  std::uint64_t begin(std::int64_t utc_ms = kNow) {
    const std::string device = "a";
    return store->numbers().join(std::span(&device, 1), utc_ms).at(0);
  }
  bool add(std::vector<SampleRow> made, Store::Hold hold = Store::Hold::no) {
    return store->samples().append(made, hold);
  }
  /// Returns the journal entry of a command that has just arrived.
  JournalEntry arrived(std::string id, std::string result = {}, std::int64_t received_ms = kNow) {
    JournalEntry made = entry(std::move(id), std::move(result), received_ms);
    made.number = store->audit().next_command_number();
    return made;
  }
  /// Puts a command in the journal. False: the disk refused it.
  bool journal(JournalEntry command) {
    return store->journal().journal(std::vector{std::move(command)});
  }
  void record(JournalEntry result) { store->journal().record(std::move(result)); }
  void record_acknowledged(const JournalEntry& result) {
    record(result);
    store->journal().acknowledge(result.device, result.id, result.number);
  }
  std::optional<JournalEntry> found(const std::string& id) const {
    return store->journal().find("a", id);
  }
  /// Returns all pending rows message by message, acknowledging each.
  std::string drain(std::size_t max_payload = 65536) {
    std::string all;
    while (const auto batch = test::next(store->samples(), max_payload, any)) {
      all += batch->stream.device + "/" + batch->stream.group + batch->payload.substr(23);
      EXPECT_EQ(store->samples().remove(*batch), batch->row_ids.size());
    }
    return all;
  }
};

struct OpenShelf : Shelf {
  OpenShelf() { open(); }
};
struct AlwaysSyncedShelf : Shelf {
  AlwaysSyncedShelf() {
    config.sync_always = true;
    open();
  }
};

/// A store that keeps everything in memory, until there is a disk.
struct ShelfWithoutDisk : Shelf {
  ShelfWithoutDisk() {
    block();
    open();
  }
  void bring_disk() {
    std::filesystem::remove(config.path);
    store->upkeep(kStart, kNow);
    store->upkeep(kStart + std::chrono::seconds(10), kNow);
  }
};

/// Returns the audit records of a store as another process reads them. Expects an intact chain.
inline std::vector<std::string> audit_of(const std::string& file) {
  std::vector<std::string> texts;
  audit::Verifier verifier;
  audit::Head head;
  const auto unread = AuditTrail::read(
      file,
      [&](const audit::Record& record) {
        verifier.add(record);
        texts.push_back(record.text);
      },
      head);
  EXPECT_FALSE(unread) << unread->why;
  for (const audit::Finding& finding : verifier.finish(head))
    ADD_FAILURE() << finding.record << ": " << finding.text;
  return texts;
}
inline std::vector<std::string> audit_of(const Shelf& shelf) { return audit_of(shelf.file()); }

inline std::string told(const std::string& id) { return audit::delivery(1, "a", id, true, kNow); }

}  // namespace fxagent::test
