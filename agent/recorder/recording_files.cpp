#include "agent/recorder/recording_files.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <sstream>
#include <system_error>
#include <utility>

#include "agent/recorder/recording.h"
#include "agent/store/disk/durable_file.h"
#include "agent/store/disk/store_file.h"

namespace fxagent {
namespace {

namespace fs = std::filesystem;

constexpr const char* kLock = "lock";
constexpr const char* kRequest = "request";
constexpr const char* kAnswer = "answer";
constexpr std::size_t kMostRequestBytes = std::size_t{1} << 20;

struct flock whole_file() {
  struct flock range {};
  range.l_type = F_WRLCK;
  range.l_whence = SEEK_SET;
  return range;
}

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);)
    if (!line.empty()) lines.push_back(std::move(line));
  return lines;
}

}  // namespace

RecordingFiles::RecordingFiles(std::string directory, std::size_t most_files,
                               std::uint64_t most_bytes)
    : directory_(std::move(directory)), most_files_(most_files), most_bytes_(most_bytes) {}

std::string RecordingFiles::begin() {
  if (std::string fault = make_store_directory(directory_); !fault.empty()) return fault;
  // Of an earlier run. Before the lock, because whoever sees the lock may leave a new one.
  if (!writer_of(directory_))
    if (std::string fault = DurableFile(directory_, kRequest).remove(); !fault.empty())
      return fault;
  const std::string path = directory_ + "/" + kLock;
  lock_ = FileHandle(
      ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, S_IRUSR | S_IWUSR));
  if (lock_ < 0) return fault_of_system(path);
  struct flock range = whole_file();
  if (::fcntl(lock_, F_SETLK, &range) != 0) {
    lock_.close();
    return in_use(directory_, path);
  }
  return DurableFile(directory_, kAnswer).write("");
}

std::string RecordingFiles::make_room(std::uint64_t bytes, const std::string& time) const {
  if (bytes > most_bytes_)
    return "the recording has " + std::to_string(bytes) + " bytes, and max_bytes is " +
           std::to_string(most_bytes_) + ": raise it or lower link_bytes";
  std::vector<std::pair<fs::path, std::uint64_t>> files;
  std::uint64_t total = bytes;
  std::error_code fault;
  const std::string unfinished = std::string(kRecordingSuffix) + ".new";
  for (const fs::directory_entry& entry : fs::directory_iterator(directory_, fault)) {
    if (entry.path().string().ends_with(unfinished)) {  // left by a crash
      std::error_code ignored;
      fs::remove(entry.path(), ignored);
    }
    std::error_code gone;
    if (entry.path().extension() != kRecordingSuffix || !entry.is_regular_file(gone)) continue;
    const std::uint64_t size = entry.file_size(gone);
    if (gone) continue;
    files.emplace_back(entry.path(), size);
    total += size;
  }
  if (fault) return directory_ + ": " + fault.message();
  std::ranges::sort(files);  // by name, which begins with the time
  const auto is_later = [&](const auto& file) {
    const std::string name = file.first.filename().string();
    const bool is_ours = name.size() > time.size() && name[4] == '-' && name[10] == 'T';
    return is_ours && name.front() <= '9' && name.compare(0, time.size(), time) > 0;
  };
  std::ranges::stable_partition(files, is_later);
  std::size_t left = files.size();
  for (const auto& [path, size] : files) {
    if (left < most_files_ && total <= most_bytes_) break;
    if (!fs::remove(path, fault) && fault) return path.string() + ": " + fault.message();
    total -= size;
    --left;
  }
  return {};
}

std::string RecordingFiles::write(std::string_view link, std::int64_t written_us,
                                  std::string_view text, std::string& path) {
  if (lock_ < 0)
    if (std::string fault = begin(); !fault.empty()) return fault;
  std::string name = utc_us_text(written_us);
  std::ranges::replace(name, ':', '-');
  if (std::string fault = make_room(text.size(), name); !fault.empty()) return fault;
  name.append("-").append(link).append(kRecordingSuffix);
  const DurableFile file(directory_, name);
  if (std::string fault = file.write(text); !fault.empty()) return fault;
  path = file.path();
  return {};
}

std::vector<std::string> RecordingFiles::take_request() {
  const DurableFile file(directory_, kRequest);
  const auto text = file.read(kMostRequestBytes);
  file.remove();
  return text && *text ? lines_of(**text) : std::vector<std::string>();
}

std::string RecordingFiles::answer(std::int64_t now_us, const std::vector<std::string>& paths) {
  std::string text = utc_us_text(now_us) + "\n";
  for (const std::string& path : paths)
    if (std::error_code ignored; fs::exists(path, ignored)) text += path + "\n";
  return DurableFile(directory_, kAnswer).write(text);
}

std::optional<pid_t> writer_of(const std::string& directory) {
  const std::string path = directory + "/" + kLock;
  const FileHandle file(::open(path.c_str(), O_RDWR | O_CLOEXEC | O_NOFOLLOW));
  if (file < 0) return std::nullopt;
  struct flock range = whole_file();
  const bool known = ::fcntl(file, F_GETLK, &range) == 0 && range.l_type != F_UNLCK;
  return known ? std::optional(range.l_pid) : std::nullopt;
}

std::string leave_request(const std::string& directory, const std::vector<std::string>& links) {
  std::string text;
  for (const std::string& link : links) text += link + "\n";
  return DurableFile(directory, kRequest).write(text);
}

std::string last_answer(const std::string& directory) {
  const auto text = DurableFile(directory, kAnswer).read(kMostRequestBytes);
  return text ? text->value_or("") : "";
}

}  // namespace fxagent
