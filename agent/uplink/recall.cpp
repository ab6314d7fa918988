#include "agent/uplink/recall.h"

#include <algorithm>
#include <map>
#include <optional>
#include <string>
#include <utility>

#include "agent/log.h"
#include "agent/uplink/json.h"

namespace fxagent {
namespace {

CommandResult left_behind(const JournalEntry& entry) {
  CommandResult result;
  result.id = entry.id;
  result.op = entry.op;
  result.received_ms = entry.received_ms;
  if (op_from(entry.op) == Op::read) {
    result.status = CommandStatus::failed;
    result.reason = Reason::shutting_down;
    result.detail = "the agent ended before the device was read";
  } else {
    result.status = CommandStatus::unknown_outcome;
    result.detail = kLeftBehind;
  }
  return result;
}

/// A write is judged by the field, which can read what it was to write.
std::optional<Command> to_be_read(const JournalEntry& entry, std::uint32_t device,
                                  std::int64_t utc_ms, SteadyTime now) {
  if (op_from(entry.op) != Op::write || entry.payload.empty()) return std::nullopt;
  Command command = json::command(entry.payload);
  if (command.refusal || command.id != entry.id) return std::nullopt;
  command.device = device;
  command.arrival = entry.arrival;
  command.received_ms = entry.received_ms;
  command.received =
      now - std::chrono::milliseconds(std::max<std::int64_t>(utc_ms - entry.received_ms, 0));
  command.response_topic = entry.response_topic;
  command.correlation = entry.correlation;
  return command;
}

void take_orders(const Config& config, Store& store, std::vector<JournalEntry> entries,
                 std::int64_t utc_ms, SteadyTime now, Recall& found) {
  std::map<std::string, std::uint32_t> index;
  for (const DeviceConfig& device : config.devices)
    index.emplace(device.name, static_cast<std::uint32_t>(index.size()));
  for (JournalEntry& entry : entries) {
    const auto device = index.find(entry.device);
    if (device == index.end()) continue;
    // A store that opened late: this run has carried out an order of that id itself.
    if (entry.result.empty()) {
      const auto known = store.find(entry.device, entry.id);
      if (known && known->arrival > entry.arrival) continue;
    }
    if (entry.result.empty() && !entry.told) {
      log::warn("order_left_behind", {{"device", entry.device}, {"id", entry.id}});
      if (auto command = to_be_read(entry, device->second, utc_ms, now)) {
        found.field.left_behind.push_back(std::move(*command));
        continue;
      }
      entry.result = json::result(left_behind(entry), std::nullopt);
      if (entry.arrival != 0)
        entry.audit = audit::result(entry.arrival, entry.device, entry.result, {}, utc_ms);
      store.record(entry);
    }
    CommandResult result = json::recorded_result(entry.result);
    result.device = device->second;
    result.arrival = entry.arrival;
    result.id = entry.id;
    result.received_ms = entry.received_ms;
    result.response_topic = std::move(entry.response_topic);
    result.correlation = std::move(entry.correlation);
    if (!entry.told) found.untold.push_back(result);
    found.field.results.push_back({std::move(result), entry.deadline_ms});
  }
}

}  // namespace

Recall recall(const Config& config, Store* store, std::int64_t utc_ms, SteadyTime now) {
  Recall found;
  if (store == nullptr) {
    found.field.last_seq.assign(config.devices.size(), static_cast<std::uint64_t>(utc_ms));
    return found;
  }
  std::vector<std::string> names;
  for (const DeviceConfig& device : config.devices) names.push_back(device.name);
  found.field.last_seq = store->begin_numbers(names, utc_ms);
  take_orders(config, *store, store->remembered(), utc_ms, now, found);
  return found;
}

Recall recall(const Config& config, Store& store, Store::FoundLate late, std::int64_t utc_ms,
              SteadyTime now) {
  Recall found;
  for (const DeviceConfig& device : config.devices) {
    const auto number = late.numbers.find(device.name);
    found.field.last_seq.push_back(number == late.numbers.end() ? 0 : number->second);
  }
  take_orders(config, store, std::move(late.orders), utc_ms, now, found);
  return found;
}

}  // namespace fxagent
