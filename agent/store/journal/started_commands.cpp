#include "agent/store/journal/started_commands.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <ctime>
#include <type_traits>
#include <utility>

#include "agent/log/log.h"
#include "agent/process/this_process.h"
#include "agent/store/disk/store_file.h"

namespace fxagent {
namespace {

constexpr std::array<char, 8> kMagic{'f', 'x', 's', 't', 'a', 'r', 't', '1'};
constexpr std::size_t kBootIdLength = 36;
constexpr std::int64_t kSecond = 1'000'000'000;
// The kernel records the time of a change as it makes it, close to the time in the mark. In a copy
// that was put in its place later they differ.
constexpr std::int64_t kWrittenWithin = 2 * kSecond;

std::int64_t nanoseconds_of(std::int64_t seconds, std::int64_t nanoseconds) {
  return seconds * kSecond + nanoseconds;
}

/// Returns the time in ns UTC, from the clock that stamps files.
std::int64_t file_time() {
  timespec now{};
  ::clock_gettime(CLOCK_REALTIME_COARSE, &now);
  return nanoseconds_of(now.tv_sec, now.tv_nsec);
}

}  // namespace

/// Layout of the file: this head, then kKept records. Numbers in the machine's byte order.
struct StartedCommands::Head {
  std::array<char, 8> magic = kMagic;
  std::array<char, 40> boot{};      ///< the kernel's boot id
  std::uint64_t device = 0;         ///< these three identify the database file
  std::uint64_t file = 0;           ///<
  std::int64_t born = 0;            ///< ns UTC; 0 if the file system does not have it
  std::uint64_t floor = 0;          ///< nothing is known of commands below it
  std::int64_t written = 0;         ///< ns UTC, as file_time()
  std::array<char, 40> reserved{};  // keeps each record within one page

  bool is_of_the_same(const Head& other) const {
    return magic == other.magic && boot == other.boot && device == other.device &&
           file == other.file && born == other.born;
  }
};

/// Mark n, counted from 1, is at place (n - 1) modulo kKept.
struct StartedCommands::Record {
  std::uint64_t mark = 0;  ///< 0: the place is empty
  std::uint64_t number = 0;
  std::uint64_t floor = 0;   ///< from this mark on
  std::int64_t written = 0;  ///< ns UTC, as file_time()
};

struct StartedCommands::Content {
  Head head;
  std::array<Record, kKept> records;
};

StartedCommands::StartedCommands(const std::string& directory)
    : path_(directory + "/fxagent.db.started"), database_(store_file_path(directory)) {
  static_assert(std::is_trivially_copyable_v<Content> && sizeof(Head) == 128 &&
                sizeof(Record) == 32 && sizeof(Content) == 128 + kKept * 32);
}

void StartedCommands::go_on() {
  FileHandle handle(::open(path_.c_str(), O_RDWR | O_CLOEXEC | O_NOFOLLOW));
  const auto content = read(handle);
  if (!content) return make(first_of_run_);
  remember(*content);
  const std::lock_guard lock(mutex_);
  handle_ = std::move(handle);
  floor_ = earlier_->floor;
  marks_ = 0;
  numbers_.clear();
  for (const Record& record : content->records) {
    marks_ = std::max(marks_, record.mark);
    numbers_.push_back(record.number);
  }
}

void StartedCommands::begin_anew(std::uint64_t next_number) {
  earlier_.reset();  // belongs to another database
  {
    const FileHandle handle(::open(path_.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW));
    if (const auto content = read(handle)) remember(*content);
  }
  make(next_number);
}

void StartedCommands::close() {
  const std::lock_guard lock(mutex_);
  if (handle_ < 0) return;
  handle_.close();
  ::unlink(path_.c_str());
}

bool StartedCommands::surely_not_sent(std::uint64_t number) const {
  return earlier_ && number >= earlier_->floor && number < first_of_run_ &&
         !earlier_->started.contains(number);
}

void StartedCommands::mark(std::uint64_t number) {
  const std::lock_guard lock(mutex_);
  if (handle_ < 0) return;
  const std::size_t place = marks_ % kKept;
  // The same write overwrites an older mark and raises the floor above its command.
  if (marks_ >= kKept) floor_ = std::max(floor_, numbers_[place] + 1);
  const Record record{marks_ + 1, number, floor_, file_time()};
  if (!write_at(handle_, &record, sizeof record, sizeof(Head) + place * sizeof record))
    return withdraw(fault_of_system("write"));
  ++marks_;
  numbers_[place] = number;
}

/// Makes the file prove nothing, because its marks are not complete any more.
void StartedCommands::withdraw(const std::string& why) {
  bool is_withdrawn = false;
  if (handle_ >= 0) {
    is_withdrawn = ::ftruncate(handle_, 0) == 0;
    handle_.close();
  }
  if (!is_withdrawn) is_withdrawn = ::unlink(path_.c_str()) == 0 || errno == ENOENT;
  if (!is_withdrawn) is_withdrawn = ::truncate(path_.c_str(), 0) == 0;
  log::error(
      "command_starts",
      {{"path", path_},
       {"reason", why},
       {"note", is_withdrawn ? "after a crash, every command from now on counts as possibly sent"
                             : "delete this file: its record of commands is incomplete"}});
}

std::optional<StartedCommands::Head> StartedCommands::head_of_now(std::uint64_t floor) const {
  const std::string boot = boot_id();
  struct statx found {};
  if (boot.size() != kBootIdLength || ::statx(AT_FDCWD, database_.c_str(), AT_SYMLINK_NOFOLLOW,
                                              STATX_INO | STATX_BTIME, &found) != 0)
    return std::nullopt;
  Head head;
  std::copy(boot.begin(), boot.end(), head.boot.begin());
  head.device = (std::uint64_t{found.stx_dev_major} << 32) | found.stx_dev_minor;
  head.file = found.stx_ino;
  if ((found.stx_mask & STATX_BTIME) != 0)
    head.born = nanoseconds_of(found.stx_btime.tv_sec, found.stx_btime.tv_nsec);
  head.floor = floor;
  head.written = file_time();
  return head;
}

std::optional<StartedCommands::Content> StartedCommands::read(int handle) const {
  const auto now = head_of_now(0);
  struct stat found {};
  std::optional<Content> content(std::in_place);
  if (handle < 0 || !now || !why_not_ours(handle, path_).empty() || ::fstat(handle, &found) != 0 ||
      found.st_size != static_cast<off_t>(sizeof(Content)) ||
      ::pread(handle, &*content, sizeof(Content), 0) != static_cast<ssize_t>(sizeof(Content)) ||
      !content->head.is_of_the_same(*now))
    return std::nullopt;
  std::int64_t written = content->head.written;
  std::uint64_t last = 0;
  for (std::size_t place = 0; place < kKept; ++place) {
    const Record& record = content->records[place];
    if (record.mark == 0) continue;
    if ((record.mark - 1) % kKept != place) return std::nullopt;
    if (record.mark < last) continue;
    last = record.mark;
    written = record.written;
  }
  const auto changed = nanoseconds_of(found.st_ctim.tv_sec, found.st_ctim.tv_nsec);
  if (changed < written - kWrittenWithin || changed > written + kWrittenWithin) return std::nullopt;
  return content;
}

void StartedCommands::remember(const Content& content) {
  Earlier earlier;
  earlier.floor = content.head.floor;
  for (const Record& record : content.records) {
    earlier.floor = std::max(earlier.floor, record.floor);
    if (record.mark != 0) earlier.started.insert(record.number);
  }
  earlier_ = std::move(earlier);
}

void StartedCommands::make(std::uint64_t next_number) {
  const std::lock_guard lock(mutex_);
  handle_.close();
  // Delete the old file first: after a crash in between, nothing must be proven.
  if (::unlink(path_.c_str()) != 0 && errno != ENOENT) return withdraw(fault_of_system("delete"));
  const auto head = head_of_now(next_number);
  if (!head) return;
  handle_ = FileHandle(
      ::open(path_.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, S_IRUSR | S_IWUSR));
  if (handle_ < 0) return withdraw(fault_of_system("open"));
  const Content content{*head, {}};
  if (!write_at(handle_, &content, sizeof content, 0)) return withdraw(fault_of_system("write"));
  floor_ = next_number;
  marks_ = 0;
  numbers_.assign(kKept, 0);
}

}  // namespace fxagent
