#include "agent/commands/commands.h"

#include <algorithm>
#include <chrono>
#include <sstream>
#include <utility>
#include <variant>

#include "agent/commands/parse/parse.h"
#include "agent/commands/result.h"
#include "agent/config/suggestions.h"
#include "agent/failpoint.h"
#include "agent/text/sha256.h"
#include "agent/text/text.h"
#include "protocol/value/bytes.h"
#include "protocol/value/span.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;

constexpr std::size_t kPayloadKept = 65536;  // bytes; no command is longer
constexpr std::size_t kLinkIdsKept = 1000;

/// Returns why a command for a device that is not in the config is refused. A fault of the message
/// itself goes first, as everywhere.
Refusal refusal_of_unknown(const Command& command, const Config& config,
                           const std::string& device) {
  if (command.refusal && command.refusal->reason < Reason::duplicate_id) return *command.refusal;
  if (command.retained) return refusal_of_retained();
  std::vector<std::string_view> names;
  names.reserve(config.devices.size());
  for (const DeviceConfig& known : config.devices)
    if (!known.is_vacant()) names.push_back(known.name);
  return {Reason::unknown_device,
          "there is no device " + device + " in the config" + did_you_mean(device, names)};
}

/// Returns a hash of everything that decides what the command changes, and where: the host or port
/// of its device, the codec's options, the addresses and the raw values.
std::string place_of(const Config& config, const AdmittedCommand& admitted) {
  const DeviceConfig& device = config.devices[admitted.command.device];
  std::ostringstream text;
  text << endpoint_of(config.links[device.link]) << '\n';
  if (device.protocol != nullptr) text << device.protocol->name << '\n';
  if (device.options)
    for (const auto& [key, option] : *device.options)
      std::visit([&](const auto& value) { text << key << ' ' << value << '\n'; }, option);
  for (const AdmittedTarget& target : admitted.targets) {
    const Span span = *span_of(target.point);
    text << span.space << ' ' << span.first_bit << ' ' << span.bits << ' ' << to_hex(target.image)
         << '\n';
  }
  return short_hash(text.str());
}

/// Returns the link of this name; nullptr if there is none.
const LinkConfig* link_named(const Config& config, std::string_view name) {
  const auto link = std::ranges::find(config.links, name, &LinkConfig::name);
  return link == config.links.end() ? nullptr : &*link;
}

/// Returns for whom the port is free, and until when.
std::string yield_text(const Command& command, std::chrono::minutes time, std::int64_t utc_ms) {
  if (time.count() == 0) return "the agent opens the port again";
  const std::string& by = sender_of(command);
  return "the port is free for another program until " +
         utc_text(utc_ms + milliseconds(time).count()) +
         (by.empty() ? "" : ", as " + by + " asked");
}

audit::Receipt receipt_of(const Command& command, const std::string& device, std::string_view topic,
                          std::string_view payload) {
  return {.number = command.number,
          .device = device,
          .topic = std::string(topic),
          .payload = std::string(payload.substr(0, kPayloadKept)),
          .payload_bytes = payload.size(),
          .by = sender_of(command),
          .retained = command.retained,
          .received_ms = command.received_ms};
}

}  // namespace

Commands::Commands(const Config& config, Submit submit, CommandJournal* journal, Yield yield)
    : config_(config),
      submit_(std::move(submit)),
      yield_(std::move(yield)),
      journal_(journal),
      results_(journal) {
  shared_->is_journaled = journal != nullptr;
  devices_.resize(config.devices.size());
  for (std::uint32_t i = 0; i < devices_.size(); ++i)
    if (!config.devices[i].is_vacant()) open(i);
  list_names();
}

void Commands::open(std::uint32_t index) {
  auto& device = devices_[index];
  if (device)
    device->admission.use(config_.devices[index]);
  else
    device = std::make_unique<Device>(config_.devices[index], shared_);
}

void Commands::list_names() {
  index_.clear();
  for (std::uint32_t i = 0; i < devices_.size(); ++i)
    if (devices_[i]) index_[devices_[i]->name] = i;
}

std::optional<std::uint32_t> Commands::device_named(std::string_view name) const {
  const auto found = index_.find(name);
  return found == index_.end() ? std::nullopt : std::optional(found->second);
}

bool Commands::knows(std::string_view name) const {
  return device_named(name).has_value() || link_named(config_, name) != nullptr;
}

Commands::Device* Commands::known_device(const std::string& name) {
  if (const auto index = device_named(name)) return devices_.at(*index).get();
  const auto departed = departed_.find(name);
  return departed == departed_.end() ? nullptr : departed->second.get();
}

// ---- a changed config ---------------------------------------------------------------------------

void Commands::begin_change(const ConfigChange& change) {
  for (const std::uint32_t index : change.devices_end) devices_.at(index)->admission.close();
}

void Commands::change(const ConfigChange& change, SteadyTime now) {
  std::erase_if(departed_, [now](auto& each) { return each.second->admission.has_forgotten(now); });
  for (const std::uint32_t index : change.devices_end) {
    std::string name = devices_.at(index)->name;
    departed_[std::move(name)] = std::move(devices_[index]);
  }
  devices_.resize(config_.devices.size());
  for (const std::uint32_t index : change.devices_begin) {
    const DeviceConfig& config = config_.devices[index];
    auto known = departed_.extract(config.name);
    if (known.empty()) {
      joined_.push_back(config.name);
    } else {
      devices_[index] = std::move(known.mapped());
      set_codec(index, config.codec, nullptr);
    }
    open(index);
  }
  // Nothing that admission knows has changed, but the device has another address.
  for (const std::uint32_t index : change.devices_adjusted) open(index);
  list_names();
}

void Commands::recover_joined(SteadyTime now, std::int64_t utc_ms) {
  if (joined_.empty() || journal_ == nullptr || journal_->hangs()) return;
  auto known = recover_of(joined_, config_, *journal_, utc_ms, now);
  if (!known) return;
  joined_.clear();
  restore(std::move(*known), now, utc_ms);
}

// ---- from the message to the field --------------------------------------------------------------

void Commands::receive(const std::string& name, std::string_view topic, std::string_view payload,
                       MessageProperties properties, SteadyTime now, std::int64_t utc_ms) {
  const auto device = device_named(name);
  if (const LinkConfig* link = device ? nullptr : link_named(config_, name))
    return receive_for_link(*link, topic, payload, std::move(properties), now, utc_ms);
  Command command = parse_command(payload, properties.ops);
  static_cast<MessageProperties&>(command) = std::move(properties);
  if (!device) {
    Refusal why = refusal_of_unknown(command, config_, name);
    CommandResult result = result_of(command);
    set_outcome(result, CommandStatus::rejected, why.reason, std::move(why.detail));
    return results_.add_unrecorded(name, std::move(result));
  }
  command.device = *device;
  std::optional<audit::Receipt> receipt;  // with a journal
  if (journal_ != nullptr) {
    command.number = journal_->next_command_number();
    receipt = receipt_of(command, name, topic, payload);
  }
  failpoint("command_received");
  Device& to = *devices_.at(*device);
  auto decision = to.admission.admit(std::move(command), to.codec, to.waiting(), now);
  if (auto* result = std::get_if<CommandResult>(&decision))
    return results_.add(to.name, std::move(*result), receipt, utc_ms);
  auto& admitted = std::get<AdmittedCommand>(decision);
  to.pending.emplace(admitted.command.id, std::move(admitted.place));
  if (receipt) {
    admitted.starts = journal_->starts();
    JournalEntry entry = entry_of(admitted, name);
    entry.audit = audit::admitted(*receipt, entry.id, entry.op, utc_ms);
    entry.payload = std::move(receipt->payload);
    entry.place = place_of(config_, admitted);
    to_journal_.push_back(std::move(entry));
  }
  admitted_.push_back(std::move(admitted));
}

std::optional<Refusal> Commands::refusal_for_link(const LinkConfig& link, const Command& command,
                                                  SteadyTime now, std::int64_t utc_ms) const {
  if (command.refusal && command.refusal->reason < Reason::duplicate_id) return command.refusal;
  if (std::ranges::find(link_ids_, link.name + " " + command.id) != link_ids_.end())
    return Refusal{Reason::duplicate_id, "the command has come before and is not repeated"};
  if (command.retained) return refusal_of_retained();
  if (command.refusal) return command.refusal;
  if (!link.allow_yield || !yield_)
    return Refusal{Reason::not_allowed, "allow_yield of link " + link.name + " is not set"};
  const bool is_late = command.message_expiry && now - command.received >= *command.message_expiry;
  if (is_late || (command.expires_ms && utc_ms >= *command.expires_ms))
    return Refusal{Reason::expired, "it came too late"};
  if (!shared_->conflict.empty()) return refusal_of_conflict(shared_->conflict);
  if (shared_->is_stopping)
    return Refusal{Reason::shutting_down, why_not_sent(Reason::shutting_down)};
  return std::nullopt;
}

void Commands::receive_for_link(const LinkConfig& link, std::string_view topic,
                                std::string_view payload, MessageProperties properties,
                                SteadyTime now, std::int64_t utc_ms) {
  auto [command, time] = parse_link_command(payload);
  static_cast<MessageProperties&>(command) = std::move(properties);
  if (journal_ != nullptr) command.number = journal_->next_command_number();
  auto finish = [this, name = link.name, receipt = receipt_of(command, link.name, topic, payload),
                 result = result_of(command),
                 utc_ms](CommandStatus status, Reason reason, std::string detail) mutable {
    set_outcome(result, status, reason, std::move(detail));
    results_.add_for_link(name, std::move(result), receipt, utc_ms);
  };
  if (auto refusal = refusal_for_link(link, command, now, utc_ms)) {
    const Reason why = refusal->reason;
    return finish(why == Reason::duplicate_id ? CommandStatus::duplicate
                  : why == Reason::expired    ? CommandStatus::expired
                                              : CommandStatus::rejected,
                  why, std::move(refusal->detail));
  }
  if (!command.id.empty()) {
    link_ids_.push_back(link.name + " " + command.id);
    if (link_ids_.size() > kLinkIdsKept) link_ids_.pop_front();
  }
  const std::string text = yield_text(command, time, utc_ms);
  yield_(link.name, time, text, [finish, text](Reason why) mutable {
    if (why == Reason::none) return finish(CommandStatus::succeeded, why, text);
    finish(CommandStatus::failed, why, why_not_sent(why));
  });
}

void Commands::hand_over(std::int64_t utc_ms) {
  if (admitted_.empty()) return;
  failpoint("command_admitted");
  // A disk that refuses does not stop the plant. The store's state reports it.
  if (journal_ != nullptr) journal_->journal(std::exchange(to_journal_, {}));
  failpoint("command_journaled");
  const bool hangs = journal_ != nullptr && journal_->hangs();
  for (AdmittedCommand& admitted : std::exchange(admitted_, {})) {
    const Command& command = admitted.command;
    // A read changes nothing, so recovery does not need its entry.
    if (!hangs || command.op == Op::read) {
      submit_(std::move(admitted));
      continue;
    }
    CommandResult result = result_of(admitted);
    set_outcome(result, CommandStatus::rejected, Reason::store_unavailable,
                "the store's disk does not respond, so the command cannot be recorded before it is "
                "sent; nothing was sent");
    finish(std::move(result), utc_ms);
  }
}

void Commands::restore(Recovered known, SteadyTime now, std::int64_t utc_ms) {
  for (const KnownId& id : known.ids)
    if (Device* device = known_device(id.device)) device->admission.restore(id, now, utc_ms);
  for (CommandResult& result : known.unacknowledged) {
    const std::string& device = devices_.at(result.device)->name;
    results_.add(device, std::move(result), {}, utc_ms);
  }
  for (const auto& [command, place] : known.interrupted) {
    Device& device = *devices_.at(command.device);
    auto admitted = device.admission.interrupted(command, device.codec, now);
    if (admitted && place == place_of(config_, *admitted)) {
      device.pending.emplace(command.id, nullptr);
      submit_(std::move(*admitted));
      continue;
    }
    CommandResult result = result_of(command);
    result.received = {};
    set_interrupted(result);
    finish(std::move(result), utc_ms);
  }
}

void Commands::finish(CommandResult result, std::int64_t utc_ms) {
  Device& device = *devices_.at(result.device);
  const auto pending = device.pending.find(result.id);
  if (pending != device.pending.end()) {
    // An earlier run received it, by another steady clock.
    if (pending->second == nullptr) result.received = {};
    device.pending.erase(pending);
  }
  device.admission.finished(result);
  results_.add(device.name, std::move(result), {}, utc_ms);
}

}  // namespace fxagent
