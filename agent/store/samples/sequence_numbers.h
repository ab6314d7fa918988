// The sequence number of each device. Numbers are reserved on disk ahead of their use; a marker
// file records that the disk lacks some. The store's thread.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "agent/store/disk/durable_file.h"
#include "agent/store/disk/store_disk.h"

namespace fxagent {

class SequenceNumbers final : public StorePart {
 public:
  /// Numbers that one write reserves. The next write follows when half of them are used.
  static constexpr std::uint64_t kBlock = 10000;
  /// Numbers skipped after the last on disk if the marker exists: the number used since is unknown.
  static constexpr std::uint64_t kUnknown = 1000000;

  SequenceNumbers(const StoreConfig& config, StoreDisk& disk)
      : config_(config), disk_(disk), behind_(config.path, "fxagent.db.behind") {}

  /// Returns, for each device, the number before its first sample in this boot. After a clean stop,
  /// or with `sync: always`, it is the last one used. After a crash, or if the disk refused, it is
  /// above all that may have been used. For a device that was there before in this boot it is the
  /// last number used. Call at the start, and for devices that join later.
  std::vector<std::uint64_t> join(std::span<const std::string> devices, std::int64_t utc_ms);
  /// Call before a sample with this number leaves the agent.
  void used(const std::string& device, std::uint64_t seq);
  /// True if used() has to write to the disk.
  bool asks_disk(const std::string& device, std::uint64_t seq) const;

  /// True if a device has used half of its block: call reserve() soon.
  bool is_short() const { return is_short_; }
  /// Commits the next block of each device that is short of numbers.
  void reserve();
  /// Commits what each device has reserved or used, for a file that lacks it, and removes the
  /// marker. If there is a marker, adds the other devices of the file before: it counts for them
  /// too. Makes the marker if the disk refuses.
  void write_all();
  /// Clean end: commits the last numbers used. The next boot continues right after them.
  void write_last();
  /// Within the commit of samples with these highest numbers: writes them with `sync: always`.
  /// Throws SQLite::Exception.
  void write_with_samples(const std::map<std::string, std::uint64_t>& highest);
  /// Makes the marker if the disk refuses to write: it may lack numbers that were used.
  void refused();
  /// For a file that opened late. Returns, for each device of this run, the number in the file if
  /// it is above this run's; the device continues there. Call write_all() afterwards.
  std::map<std::string, std::uint64_t> above_ours();

  void load(SQLite::Database& database) override;
  void unload(Rows /*rows*/) override { insert_.reset(); }
  void replaced() override { write_all(); }

 private:
  struct Numbers {
    std::uint64_t last = 0;      ///< used
    std::uint64_t reserved = 0;  ///< usable up to here without a write
  };
  /// A number in the file when it opened; the marker is taken into account.
  struct Found {
    std::uint64_t last = 0;
    bool exact = false;  ///< else the clock may be above it
  };
  /// Meaning of a number in the file: the end of a block, or the last one used.
  enum class Meaning : std::uint8_t { reserved, exact };

  std::uint64_t add(const std::string& device, std::int64_t utc_ms);
  bool write(const std::map<std::string, std::uint64_t>& numbers, Meaning meaning);

  const StoreConfig config_;
  StoreDisk& disk_;
  std::optional<SQLite::Statement> insert_;
  std::map<std::string, Numbers> numbers_;
  std::map<std::string, Found> found_;
  bool is_short_ = false;
  const DurableFile behind_;      ///< marker: the database lacks some numbers
  bool is_behind_ = false;        ///< the marker exists
  bool is_mark_refused_ = false;  ///< it could not be made; write_all() tries again
};

}  // namespace fxagent
