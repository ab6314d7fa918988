#include "agent/commands/recovery.h"

#include <algorithm>
#include <iterator>
#include <map>
#include <optional>
#include <string>
#include <utility>

#include "agent/commands/audit_records.h"
#include "agent/commands/parse/parse.h"
#include "agent/commands/result.h"
#include "agent/log/log.h"

namespace fxagent {
namespace {

/// Returns the command as received, or nullopt if the journal does not have it.
std::optional<Command> command_of(const JournalEntry& entry, std::uint32_t device,
                                  std::int64_t utc_ms, SteadyTime now) {
  if (entry.payload.empty()) return std::nullopt;
  Command command = parse_command(entry.payload);
  if (command.refusal || command.id != entry.id) return std::nullopt;
  command.device = device;
  command.number = entry.number;
  command.received_ms = entry.received_ms;
  command.received =
      now - std::chrono::milliseconds(std::max<std::int64_t>(utc_ms - entry.received_ms, 0));
  command.response_topic = entry.response_topic;
  command.correlation = entry.correlation;
  return command;
}

/// Returns the result of a command whose outcome cannot or need not be read back.
CommandResult interrupted(const JournalEntry& entry, const std::optional<Command>& command) {
  CommandResult result;
  if (command) {
    result = result_of(*command);
  } else if (const Command refused = parse_command(entry.payload); refused.id == entry.id) {
    result.id_is_number = refused.id_is_number;
  }
  result.id = entry.id;
  result.op = entry.op;
  result.received_ms = entry.received_ms;
  // A command that waited, and a read, had no effect.
  const bool is_read = op_from(entry.op) == Op::read;
  if (entry.surely_not_sent || is_read)
    set_outcome(result, CommandStatus::failed, Reason::interrupted,
                is_read ? "the agent ended before the device was read"
                        : "the agent ended before anything was written");
  else
    set_interrupted(result);
  return result;
}

void take(JournalEntry entry, std::uint32_t device, CommandJournal& journal, std::int64_t utc_ms,
          SteadyTime now, Recovered& found) {
  if (entry.result.empty()) {
    // If the store opened late, this run may have carried out a command of that id itself.
    const auto known = journal.find(entry.device, entry.id);
    if (known && (known->number > entry.number || !known->result.empty())) return;
    log::warn("command_interrupted", {{"device", entry.device},
                                      {"id", entry.id},
                                      {"sent", entry.surely_not_sent ? "no" : "perhaps"}});
    auto command = command_of(entry, device, utc_ms, now);
    // The field reads back what a write was to set.
    if (command && command->op == Op::write && !entry.surely_not_sent)
      return found.interrupted.push_back({std::move(*command), std::move(entry.place)});
    entry.result = result_text(interrupted(entry, command));
    if (entry.number != 0)
      entry.audit = audit::result(entry.number, entry.device, entry.result, {}, utc_ms);
    journal.record(entry);
  }
  found.ids.push_back(entry);
  CommandResult result = recorded_result(entry.result);
  result.device = device;
  result.number = entry.number;
  result.id = std::move(entry.id);
  result.received_ms = entry.received_ms;
  result.response_topic = std::move(entry.response_topic);
  result.correlation = std::move(entry.correlation);
  found.unacknowledged.push_back(std::move(result));
}

}  // namespace

Recovered recover(const Config& config, CommandJournal& journal, std::int64_t utc_ms,
                  SteadyTime now, const std::vector<JournalEntry>& newer) {
  std::vector<KnownId> ids = journal.known_ids({});
  std::vector<JournalEntry> unacknowledged = journal.unacknowledged({});
  for (const JournalEntry& entry : newer) {
    ids.push_back(entry);
    std::erase_if(unacknowledged, [&](const JournalEntry& other) {
      return other.device == entry.device && other.id == entry.id;
    });
    if (!entry.acknowledged) unacknowledged.push_back(entry);
  }
  return recover(config, journal, std::move(ids), std::move(unacknowledged), utc_ms, now);
}

std::optional<Recovered> recover_of(const std::vector<std::string>& devices, const Config& config,
                                    CommandJournal& journal, std::int64_t utc_ms, SteadyTime now) {
  std::vector<KnownId> ids;
  std::vector<JournalEntry> unacknowledged;
  for (const std::string& device : devices) {
    std::ranges::move(journal.known_ids(device), std::back_inserter(ids));
    if (!journal.was_read()) return std::nullopt;
    std::ranges::move(journal.unacknowledged(device), std::back_inserter(unacknowledged));
    if (!journal.was_read()) return std::nullopt;
  }
  return recover(config, journal, std::move(ids), std::move(unacknowledged), utc_ms, now);
}

Recovered recover_unanswered(const Config& config, CommandJournal& journal, JournalEntry left,
                             const std::string& topic, std::int64_t utc_ms, SteadyTime now) {
  if (std::ranges::find(config.devices, left.device, &DeviceConfig::name) == config.devices.end())
    return {};
  left.number = journal.next_command_number();
  journal.note(audit::announced(left, topic, utc_ms));
  if (!left.result.empty()) {
    left.audit = audit::result(left.number, left.device, left.result, {}, utc_ms);
    journal.record(left);
  }
  return recover(config, journal, {}, {std::move(left)}, utc_ms, now);
}

Recovered recover(const Config& config, CommandJournal& journal, std::vector<KnownId> ids,
                  std::vector<JournalEntry> unacknowledged, std::int64_t utc_ms, SteadyTime now) {
  std::map<std::string, std::uint32_t> index;
  for (std::uint32_t i = 0; i < config.devices.size(); ++i)
    if (!config.devices[i].is_vacant()) index.emplace(config.devices[i].name, i);
  Recovered found;
  found.ids = std::move(ids);
  // Entries of other devices stay in the journal.
  for (JournalEntry& entry : unacknowledged)
    if (const auto device = index.find(entry.device); device != index.end())
      take(std::move(entry), device->second, journal, utc_ms, now, found);
  return found;
}

}  // namespace fxagent
