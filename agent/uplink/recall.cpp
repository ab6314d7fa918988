#include "agent/uplink/recall.h"

#include <map>
#include <string>
#include <utility>

#include "agent/log.h"
#include "agent/uplink/json.h"

namespace fxagent {
namespace {

/// The word for an order that was under way, or waiting for the wire, when the agent ended.
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
    result.detail =
        "the agent ended while the order was under way: it may or may not have been carried out";
  }
  return result;
}

}  // namespace

Recall recall(const Config& config, Store* store, std::int64_t utc_ms) {
  Recall found;
  std::map<std::string, std::uint32_t> index;
  std::vector<std::string> names;
  for (const DeviceConfig& device : config.devices) {
    index[device.name] = static_cast<std::uint32_t>(names.size());
    names.push_back(device.name);
  }
  if (store == nullptr) {
    found.field.last_seq.assign(names.size(), static_cast<std::uint64_t>(utc_ms));
    return found;
  }
  found.field.last_seq = store->begin_numbers(names, utc_ms);
  for (JournalEntry& entry : store->remembered()) {
    const auto device = index.find(entry.device);
    if (device == index.end()) continue;
    if (entry.result.empty()) {
      entry.result = json::result(left_behind(entry), std::nullopt);
      if (entry.arrival != 0)
        entry.audit = audit::result(entry.arrival, entry.device, entry.result, {}, utc_ms);
      log::warn("order_left_behind", {{"device", entry.device}, {"id", entry.id}});
      store->record(entry);
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
  return found;
}

}  // namespace fxagent
