#include "agent/store/journal/unrecorded_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <optional>
#include <system_error>

#include "agent/log/log.h"
#include "agent/store/disk/store_file.h"
#include "agent/text/json.h"
#include "agent/text/sha256.h"

namespace fxagent {
namespace {

using nlohmann::json;

constexpr std::size_t kSize = UnrecordedFile::kPlaces * UnrecordedFile::kPlaceBytes;
constexpr std::array<char, 8> kPlaceMagic{'f', 'x', 'u', 'n', 'r', 'e', 'c', '1'};

/// Layout of a place: this head, then the content. Numbers in the machine's byte order.
struct PlaceHead {
  std::array<char, 8> magic{};
  std::array<char, 16> hash{};  ///< short_hash() of the content
  std::uint64_t size = 0;       ///< of the content
};
constexpr std::size_t kMostContent = UnrecordedFile::kPlaceBytes - sizeof(PlaceHead);

std::string content_of(const JournalEntry& entry) {
  std::string content;
  json::to_cbor(
      json::array({entry.number, entry.device, entry.id, entry.received_ms, entry.deadline_ms,
                   entry.op, entry.acknowledged, entry.result, entry.payload, entry.place,
                   entry.response_topic, json::binary(entry.correlation)}),
      content);
  return content;
}

/// Returns the content that fits into a place.
std::string fitting_content_of(JournalEntry entry) {
  std::string content = content_of(entry);
  if (content.size() > kMostContent) {
    // The result that the next start makes repeats the id as a number, if it was one.
    const json id = member(parsed_json(entry.result.empty() ? entry.payload : entry.result), "id");
    entry.payload = id.is_number() ? R"({"id":)" + entry.id + "}" : "";
    entry.result.clear();
    content = content_of(entry);
  }
  if (content.size() > kMostContent) {
    entry.response_topic.clear();
    entry.correlation.clear();
    content = content_of(entry);
  }
  return content;
}

std::optional<JournalEntry> entry_in(std::string_view place) {
  PlaceHead head;
  std::memcpy(&head, place.data(), sizeof head);
  if (head.magic != kPlaceMagic || head.size > kMostContent) return std::nullopt;
  const std::string_view content = place.substr(sizeof head, head.size);
  if (short_hash(content) != std::string_view(head.hash.data(), head.hash.size()))
    return std::nullopt;
  JournalEntry entry;
  try {
    const json fields = json::from_cbor(content);
    entry.number = fields.at(0).get<std::uint64_t>();
    entry.device = fields.at(1).get<std::string>();
    entry.id = fields.at(2).get<std::string>();
    entry.received_ms = std::clamp<std::int64_t>(fields.at(3).get<std::int64_t>(), 0, kLatestMs);
    entry.deadline_ms = std::clamp<std::int64_t>(fields.at(4).get<std::int64_t>(), 0, kLatestMs);
    entry.op = fields.at(5).get<std::string>();
    entry.acknowledged = fields.at(6).get<bool>();
    entry.result = fields.at(7).get<std::string>();
    entry.payload = fields.at(8).get<std::string>();
    entry.place = fields.at(9).get<std::string>();
    entry.response_topic = fields.at(10).get<std::string>();
    entry.correlation = fields.at(11).get_binary();
  } catch (const json::exception&) {
    return std::nullopt;
  }
  return entry;
}

}  // namespace

std::vector<JournalEntry> UnrecordedFile::open() {
  if (handle_ >= 0 && identity_of(path_) == identity_of(handle_)) return {};
  keys_.clear();
  places_.clear();
  is_named_ = false;
  handle_ = FileHandle(
      ::open(path_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, S_IRUSR | S_IWUSR));
  std::string why = handle_ < 0 ? fault_of_system("open") : why_not_ours(handle_, path_);
  if (why.empty() && has_full_size()) return read();
  if (why.empty() && !make()) why = fault_of_system("make");
  if (why.empty()) return {};
  handle_.close();
  failed(why);
  return {};
}

std::vector<JournalEntry> UnrecordedFile::entries_in(const std::string& directory) {
  UnrecordedFile file(directory);
  file.handle_ = open_to_read(file.path_);
  return file.has_full_size() ? file.read() : std::vector<JournalEntry>{};
}

bool UnrecordedFile::has_full_size() const {
  struct stat found {};
  return ::fstat(handle_, &found) == 0 && found.st_size == off_t{kSize};
}

/// Gives the file its full size, all places empty. Returns false, with errno set, on failure; the
/// file is then empty. Does not take the last room of the disk.
bool UnrecordedFile::make() const {
  std::error_code unknown;
  if (std::filesystem::space(directory_, unknown).available < 2 * kSize) {
    errno = ENOSPC;
    return false;
  }
  if (::ftruncate(handle_, 0) == 0 && write_at(handle_, std::string(kSize, '\0').data(), kSize, 0))
    return true;
  const int why = errno;
  static_cast<void>(::ftruncate(handle_, 0) == 0);
  errno = why;
  return false;
}

std::vector<JournalEntry> UnrecordedFile::read() {
  std::vector<JournalEntry> entries;
  std::string content(kSize, '\0');
  if (::pread(handle_, content.data(), kSize, 0) != ssize_t{kSize}) {
    failed(fault_of_system("read"));
    return entries;
  }
  std::uint64_t newest = 0;
  for (std::size_t place = 0; place < kPlaces; ++place) {
    auto entry = entry_in(std::string_view(content).substr(place * kPlaceBytes, kPlaceBytes));
    if (!entry) continue;
    keys_.resize(place + 1);
    keys_[place] = {entry->device, entry->id};
    places_[keys_[place]] = place;
    if (entry->number >= newest) next_ = (place + 1) % kPlaces;
    newest = std::max(newest, entry->number);
    entries.push_back(*std::move(entry));
  }
  return entries;
}

void UnrecordedFile::keep(const JournalEntry& entry) {
  if (handle_ < 0) return;
  const std::string content = fitting_content_of(entry);
  if (content.size() > kMostContent) return;
  Key key{entry.device, entry.id};
  auto found = places_.find(key);
  if (found == places_.end()) {
    std::size_t place = keys_.size();
    if (place < kPlaces) {
      keys_.push_back(key);
    } else {
      place = std::exchange(next_, (next_ + 1) % kPlaces);
      places_.erase(keys_[place]);
      keys_[place] = key;
    }
    found = places_.emplace(std::move(key), place).first;
  }
  PlaceHead head{.magic = kPlaceMagic, .size = content.size()};
  const std::string hash = short_hash(content);
  std::copy_n(hash.begin(), head.hash.size(), head.hash.begin());
  std::string text(reinterpret_cast<const char*>(&head), sizeof head);
  text += content;
  if (!write_at(handle_, text.data(), text.size(), found->second * kPlaceBytes))
    return failed(fault_of_system("write"));
  is_changed_ = true;
}

void UnrecordedFile::synchronise() {
  if (!std::exchange(is_changed_, false)) return;
  bool is_done = ::fsync(handle_) == 0;
  if (is_done && !is_named_) {
    const FileHandle directory(::open(directory_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
    is_named_ = is_done = directory >= 0 && ::fsync(directory) == 0;
  }
  if (!is_done) return failed(fault_of_system("synchronise"));
  has_failed_ = false;
}

void UnrecordedFile::clear() {
  if (keys_.empty()) return;
  const std::string empty(keys_.size() * kPlaceBytes, '\0');
  if (!write_at(handle_, empty.data(), empty.size(), 0)) failed(fault_of_system("clear"));
  keys_.clear();
  places_.clear();
  next_ = 0;
}

void UnrecordedFile::failed(const std::string& why) {
  if (std::exchange(has_failed_, true)) return;
  log::error(
      "unrecorded_commands",
      {{"path", path_},
       {"reason", why},
       {"note", "while the store is in memory, the next start does not know the commands of now"}});
}

}  // namespace fxagent
