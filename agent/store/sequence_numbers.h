// The sequence numbers that each device has reached: reserved ahead of their use, and marked where
// the disk does not know them. The store's thread.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "agent/store/durable_file.h"
#include "agent/store/store_disk.h"

namespace fxagent {

class SequenceNumbers final : public StorePart {
 public:
  /// What is written of the numbers: how far a boot may count without asking again.
  static constexpr std::uint64_t kBlock = 10000;
  /// Behind the last number that the disk knows, where it refused and nobody knows how many
  /// followed.
  static constexpr std::uint64_t kUnknown = 1000000;

  SequenceNumbers(const StoreConfig& config, StoreDisk& disk)
      : config_(config), disk_(disk), behind_(config.path, "fxagent.db.behind") {}

  /// For each of these devices the number before its first sample in this boot. After a clean
  /// stop, and with `sync: always`, the last one used; after a crash, and where the disk refused,
  /// one above all that may have been used. Once, at the start.
  std::vector<std::uint64_t> begin(std::span<const std::string> devices, std::int64_t utc_ms);
  /// The same for devices that join in the middle of it. Of one that was there before in this boot
  /// it is the last number used.
  std::vector<std::uint64_t> join(std::span<const std::string> devices, std::int64_t utc_ms);
  /// To be called before a sample with this number leaves the agent.
  void used(const std::string& device, std::uint64_t seq);
  /// True if used() has to write on the disk.
  bool asks_disk(const std::string& device, std::uint64_t seq) const;

  /// Whether some device has used half of its block, and reserve() is to be called soon.
  bool is_short() const { return is_short_; }
  /// Commits the next block of each device that is short of numbers.
  void reserve();
  /// Commits what each device has reserved or used: to a file that does not know it yet.
  void write_all();
  /// The clean end: the next boot goes on right behind the numbers used.
  void write_last();
  /// Within the commit of samples with these highest numbers. Throws SQLite::Exception.
  void write_with_samples(const std::map<std::string, std::uint64_t>& highest);
  /// The disk has refused samples, and their numbers with them.
  void refused();
  /// Of each device of this run the number that the file has, where that is above this run's.
  std::map<std::string, std::uint64_t> above_ours();

  void load(SQLite::Database& database) override;
  void unload(Rows /*rows*/) override { insert_.reset(); }
  void replaced() override { write_all(); }

 private:
  struct Numbers {
    std::uint64_t last = 0;      ///< used
    std::uint64_t reserved = 0;  ///< up to here without asking
  };
  /// What a number in the file says: that its block ends there, or that it was the last one used.
  enum class Meaning : std::uint8_t { reserved, exact };

  std::vector<std::uint64_t> add(std::span<const std::string> devices, std::int64_t utc_ms,
                                 std::map<std::string, std::uint64_t>& reserved);
  bool write(const std::map<std::string, std::uint64_t>& numbers, Meaning meaning);
  void mark_as_behind();
  void mark_as_known();

  const StoreConfig config_;
  StoreDisk& disk_;
  std::optional<SQLite::Statement> insert_;
  std::map<std::string, Numbers> numbers_;
  bool is_short_ = false;
  const DurableFile behind_;  ///< a mark that the database does not know all numbers
  bool is_behind_ = false;    ///< the mark is there
};

}  // namespace fxagent
