#include "agent/store/journal/earlier_commands.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "agent/log/log.h"
#include "agent/store/disk/store_file.h"
#include "agent/store/journal/unrecorded_file.h"

namespace fxagent {

EarlierCommands::EarlierCommands(const std::string& directory)
    : path_(store_file_path(directory)), unrecorded_(UnrecordedFile::entries_in(directory)) {
  if (open_to_read(path_) < 0) return;
  read([this] {
    database_.emplace(sqlite::open_read_only(path_));
    table_.emplace(*database_);
  });
}

template <class Work>
void EarlierCommands::read(Work&& work) {
  if (const auto fault = sqlite::attempt(work))
    log::error("store", {{"path", path_},
                         {"reason", "read: " + fault->text},
                         {"note",
                          "commands of earlier runs are not known: the agent carries out such a "
                          "command again if it is sent again"}});
}

std::vector<KnownId> EarlierCommands::known_ids(const std::string& device) {
  std::vector<KnownId> ids;
  if (table_)
    read([&] {
      ids = table_->known_ids(device);
      std::ranges::copy(table_->unacknowledged(device), std::back_inserter(ids));
    });
  std::ranges::copy_if(unrecorded_, std::back_inserter(ids), [&](const JournalEntry& entry) {
    return device.empty() || entry.device == device;
  });
  return ids;
}

std::optional<JournalEntry> EarlierCommands::find(const std::string& device,
                                                  const std::string& id) {
  std::optional<JournalEntry> found;
  if (table_) read([&] { found = table_->find(device, id); });
  return found;
}

}  // namespace fxagent
