// Commands and their results: what of them is noted before what, and until when a result is sent.
#include <algorithm>
#include <utility>

#include "agent/commands/admission.h"
#include "agent/commands/parse.h"
#include "agent/commands/result_text.h"
#include "agent/failpoint.h"
#include "agent/log/log.h"
#include "agent/uplink/puback.h"
#include "agent/uplink/publisher.h"
#include "agent/uplink/topics.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr std::size_t kPayloadKept = 65536;  // no command is longer
constexpr std::size_t kCommandsAStep = 32;   // samples and results go out in between
// What has come and has no decision yet. Above it messages stay in the network.
constexpr std::size_t kMostUndecided = 256;
constexpr std::size_t kMostUndecidedBytes = std::size_t{4} << 20;
// What has a result that the broker does not have yet.
constexpr std::size_t kMostResults = 200;
constexpr std::size_t kMostResultBytes = std::size_t{8} << 20;
// Acknowledgements come behind the messages that are held back, so that some of them are let in.
constexpr milliseconds kLetInEvery{2};
constexpr std::size_t kLetIn = 8;  // fewer than results that go out meanwhile
// Messages between a result and its PUBACK, where kReceiveMaximum may be sent ahead. A broker that
// is slow with the PUBACK lets some more come meanwhile, of those that are let in.
constexpr std::uint64_t kFarAhead = 50 * kReceiveMaximum;
constexpr std::uint64_t kFarAheadBytes = std::uint64_t{8} << 20;  // ten of the longest are 2 MiB

}  // namespace

/// Commands are looked at a few at a time. What was published with QoS 0 comes as fast as the
/// broker can send; where there is no room for it, it is lost, as MQTT allows. With QoS 1 the
/// broker waits.
void Publisher::note_incoming(const Message& event, std::uint32_t device) {
  const bool full = incoming_.size() >= kMostUndecided || incoming_bytes_ >= kMostUndecidedBytes ||
                    results_.size() >= kMostResults || result_bytes_ >= kMostResultBytes;
  if (event.qos == 0 && full) {
    ++unasked_dropped_;
    return;
  }
  incoming_bytes_ += bytes_of(event);
  incoming_.emplace_back(event, device);
}

void Publisher::take_incoming() {
  for (std::size_t i = 0; i < kCommandsAStep && !incoming_.empty(); ++i) {
    const auto [message, device] = std::move(incoming_.front());
    incoming_.pop_front();
    incoming_bytes_ -= bytes_of(message);
    take_command(message, device);
  }
}

void Publisher::submit(Command command, std::size_t payload_bytes) {
  // What the audit keeps of it is there once more.
  submitted_.push_back(memory_of(command) + payload_bytes);
  submitted_bytes_ += submitted_.back();
  submit_(std::move(command));
}

void Publisher::take_decided() {
  for (const std::uint64_t decided = outbox_.decided(); decided_ < decided; ++decided_) {
    if (submitted_.empty()) continue;
    submitted_bytes_ -= submitted_.front();
    submitted_.pop_front();
  }
}

/// So the agent reads no faster than it can answer. What waits for a decision gets one without the
/// broker; what waits for an acknowledgement needs what comes behind the messages.
void Publisher::hold_messages(SteadyTime now) {
  if (unasked_dropped_ != 0 && now >= drop_logged_at_ + kLogDropsEvery) {
    log::error("messages_dropped",
               {{"count", std::to_string(std::exchange(unasked_dropped_, 0))},
                {"note",
                 "more commands came with QoS 0 than can be answered; with QoS 1 the "
                 "broker waits"}});
    drop_logged_at_ = now;
  }
  const bool undecided = incoming_.size() + submitted_.size() >= kMostUndecided ||
                         incoming_bytes_ + submitted_bytes_ >= kMostUndecidedBytes;
  const bool unanswered = results_.size() >= kMostResults || result_bytes_ >= kMostResultBytes;
  holding_ = link_ == Link::connected && phase_ == Phase::running && (undecided || unanswered);
  if (holding_ && result_bytes_ >= settings_.result_bytes && !paused_) stop_listening(now);
  // A SUBACK or PUBACKs.
  const bool answers_are_due = suback_by_ || (!undecided && !flights_.empty());
  awaits_decisions_ = holding_ && undecided;
  lets_in_ = holding_ && answers_are_due;
  if (!lets_in_) return broker_.hold_messages(holding_);
  if (now < let_in_at_) return;
  let_in_at_ = now + kLetInEvery;
  broker_.hold_messages(true, kLetIn);
}

/// Whether more has come since this result went than a broker sends that keeps to the Receive
/// Maximum. mosquitto 2.0.11 sends all that its queue holds, 1,000 messages, once it was full; with
/// a Receive Maximum of 1 it does not.
bool Publisher::is_far_behind(const Flight& flight) const {
  const auto* result = std::get_if<ResultFlight>(&flight);
  return result != nullptr && result->heard &&
         (heard_.messages - result->heard->messages >= kFarAhead ||
          heard_.bytes - result->heard->bytes >= kFarAheadBytes);
}

bool Publisher::broker_runs_ahead() const {
  return holding_ && receive_maximum_ > 1 && config_.mqtt.version == 5 &&
         std::ranges::any_of(flights_,
                             [this](const auto& each) { return is_far_behind(each.second); });
}

/// So many results may be on their way at once: a quarter of the window is for states and samples,
/// however many results wait.
std::size_t Publisher::result_window() const {
  return window_ >= 4 ? window_ - window_ / 4 : window_;
}

void Publisher::take_command(const Message& event, std::uint32_t device) {
  // An empty retained payload only clears the topic. On 3.1.1 its flag does not reach us.
  if (event.payload.empty() && (event.retained || config_.mqtt.version != 5)) return;
  Command command = parse_command(event.payload);
  command.device = device;
  command.retained = event.retained;
  command.received = event.received;
  command.received_ms = event.received_ms;
  command.message_expiry = event.message_expiry;
  command.response_topic = event.response_topic;
  command.correlation = event.correlation;
  if (store_ != nullptr) command.number = note_receipt(event, command);
  failpoint("command_received");
  if (phase_ == Phase::running) return submit(std::move(command), event.payload.size());

  // The field answers no more.
  CommandResult result = result_of(command);
  const auto known = store_ == nullptr || result.id.empty()
                         ? std::nullopt
                         : store_->journal().find(config_.devices[device].name, result.id);
  if (known) {
    set_outcome(result, CommandStatus::duplicate, Reason::duplicate_id, {});
    if (!known->result.empty()) result.first_number = known->number;
  } else {
    set_outcome(result, CommandStatus::rejected, Reason::shutting_down, {});
  }
  take_result(std::move(result));
}

/// For the audit, and for the journal where the command is admitted.
std::uint64_t Publisher::note_receipt(const Message& event, const Command& command) {
  audit::Receipt receipt;
  receipt.number = store_->audit().next_command_number();
  receipt.device = config_.devices.at(command.device).name;
  receipt.topic = event.topic;
  receipt.payload = event.payload.substr(0, kPayloadKept);
  receipt.payload_bytes = event.payload.size();
  receipt.by = command.by;
  receipt.retained = command.retained;
  receipt.received_ms = command.received_ms;
  return receipts_.emplace(receipt.number, std::move(receipt)).first->first;
}

void Publisher::delivered(const ResultFlight& flight, SteadyTime) {
  failpoint("result_acknowledged");
  result_copy_done(flight.result, flight.copy, Ended::acknowledged);
}

void Publisher::failed(const ResultFlight& flight, const DeliveryFailed& event, SteadyTime now) {
  const auto found = results_.find(flight.result);
  if (found == results_.end()) return;
  PendingResult::Copy& copy = found->second.copies[flight.copy];
  log::warn("publish_refused", {{"what", "result"},
                                {"topic", log::excerpt(copy.topic)},
                                {"id", found->second.result.id},
                                {"code", hex_code(event.reason_code)},
                                {"reason", event.text}});
  // A response topic is the sender's choice: where the broker refuses it, that is that.
  if (is_final(event.reason_code) || (copy.to_response_topic && event.reason_code != 0))
    return result_copy_done(flight.result, flight.copy, Ended::refused);
  copy.in_flight = false;
  copy.due = Due{now + back_off(copy.due.failures), copy.due.failures + 1};
  refused_results_.insert(flight.result);
}

void Publisher::take_admitted(std::vector<AdmissionNote> notes) {
  if (notes.empty()) return;
  std::vector<JournalEntry> entries;
  for (AdmissionNote& note : notes) {
    JournalEntry entry;
    entry.device = config_.devices.at(note.device).name;
    entry.id = note.id;
    entry.received_ms = note.received_ms;
    entry.deadline_ms = note.deadline_ms;
    entry.op = std::move(note.op);
    entry.response_topic = std::move(note.response_topic);
    entry.correlation = std::move(note.correlation);
    entry.number = note.number;
    if (auto receipt = receipts_.extract(note.number)) {
      entry.audit = audit::ordered(receipt.mapped(), entry.id, entry.op, utc_ms_());
      entry.payload = std::move(receipt.mapped().payload);
    }
    entries.push_back(std::move(entry));
  }
  failpoint("order_admitted");
  // A disk that refuses does not stop the plant: its state says what is missing.
  if (store_ != nullptr) store_->journal().journal(entries);
  failpoint("order_journaled");
  for (AdmissionNote& note : notes) go_ahead_(note.device, std::move(note.id));
}

/// Whether the journal knows the id, and with it the result, from now on.
bool Publisher::note_result(const CommandResult& result) {
  if (store_ == nullptr) return false;
  const bool remembered =
      !result.id.empty() && !result.dry_run && result.status != CommandStatus::duplicate;
  if (!result.recorded.empty()) return remembered;
  JournalEntry entry;
  entry.result = result_text(result, std::nullopt);
  entry.audit = audit_of(result, entry.result);
  if (!remembered) {
    store_->audit().note(std::move(entry.audit));
    return false;
  }
  entry.device = config_.devices.at(result.device).name;
  entry.id = result.id;
  entry.received_ms = result.received_ms;
  entry.deadline_ms = result.received_ms;  // of a command it is there already
  entry.op = result.op;
  entry.response_topic = result.response_topic;
  entry.correlation = result.correlation;
  entry.number = result.number;
  entry.refused =
      result.status == CommandStatus::rejected || result.status == CommandStatus::expired;
  to_record_.push_back(std::move(entry));
  return true;
}

void Publisher::record_results() {
  if (to_record_.empty()) return;
  store_->journal().record(std::exchange(to_record_, {}));
  failpoint("result_recorded");
}

/// `text`: the result as JSON.
std::string Publisher::audit_of(const CommandResult& result, const std::string& text) {
  if (result.number == 0) return {};
  if (const auto receipt = receipts_.extract(result.number))
    return audit::answered(receipt.mapped(), text, utc_ms_());
  return audit::result(result.number, config_.devices.at(result.device).name, text, result.frames,
                       utc_ms_());
}

/// The first result of a DUPLICATE is in the journal, unless that was lost or set aside.
void Publisher::find_first(CommandResult& result) {
  if (!result.first_number || result.first || store_ == nullptr) return;
  record_results();
  const auto known = store_->journal().find(config_.devices.at(result.device).name, result.id);
  if (!known || known->result.empty() || known->number != result.first_number) {
    result.detail = "the first result is not in the journal any more; the command is not repeated";
    return;
  }
  CommandResult first = recorded_result(known->result);
  first.id = result.id;
  result.plc = first.plc;
  result.first = std::make_shared<const CommandResult>(std::move(first));
}

void Publisher::take_result(CommandResult result) {
  ++commands_[result.status];
  find_first(result);
  PendingResult pending;
  const std::string& device = config_.devices.at(result.device).name;
  pending.copies.push_back({.topic = device_topic(result.device) + "/result"});
  if (!result.response_topic.empty()) {
    const std::string fault =
        response_topic_fault(result.response_topic, config_.root, base_, device);
    if (fault.empty()) {
      pending.copies.push_back({.topic = result.response_topic, .to_response_topic = true});
    } else {
      log::warn(
          "response_topic_ignored",
          {{"topic", log::excerpt(result.response_topic)}, {"id", result.id}, {"reason", fault}});
      result.response_topic = {};
    }
  }
  failpoint("result_taken");
  pending.journaled = note_result(result);
  result.response_topic = {};  // the copy has it
  pending.bytes = sizeof(pending) + memory_of(result) + pending.copies.back().topic.size();
  result_bytes_ += pending.bytes;
  pending.result = std::move(result);
  results_.emplace(next_result_++, std::move(pending));
}

void Publisher::pump_results(SteadyTime now) {
  auto results_on_their_way =
      static_cast<std::size_t>(std::ranges::count_if(flights_, [](const auto& each) {
        return std::holds_alternative<ResultFlight>(each.second);
      }));
  for (auto& [key, pending] : results_) {
    for (std::size_t i = 0; i < pending.copies.size(); ++i) {
      PendingResult::Copy& copy = pending.copies[i];
      if (copy.in_flight || copy.done || copy.due.not_before > now) continue;
      if (!has_room() || results_on_their_way >= result_window()) return;
      if (pending.payload.empty())
        pending.payload = result_text(pending.result, now - pending.result.received);
      copy.in_flight = true;
      Publication publication;
      publication.topic = copy.topic;
      publication.payload = pending.payload;
      publication.correlation = pending.result.correlation;
      // The device's own topic gets the result even where the broker does not take it with its
      // echo.
      if (!copy.to_response_topic && !fits(publication)) publication.correlation.clear();
      samples_first_ = result_window() == window_;
      send(ResultFlight{key, i, holding_ ? std::optional(heard_) : std::nullopt},
           std::move(publication));
      ++results_on_their_way;
      failpoint("result_published");
    }
  }
}

void Publisher::result_copy_done(std::uint64_t result, std::size_t copy, Ended how) {
  const auto found = results_.find(result);
  if (found == results_.end()) return;
  auto& copies = found->second.copies;
  copies[copy].done = true;
  copies[copy].acknowledged = how == Ended::acknowledged;
  if (!std::all_of(copies.begin(), copies.end(), [](const auto& each) { return each.done; }))
    return;
  const CommandResult& done = found->second.result;
  const std::string& device = config_.devices.at(done.device).name;
  if (store_ != nullptr && done.number != 0)
    store_->audit().note(
        audit::told(done.number, device, done.id, copies.front().acknowledged, utc_ms_()));
  if (found->second.journaled) store_->journal().acknowledge(device, done.id, done.number);
  result_bytes_ -= found->second.bytes;
  refused_results_.erase(found->first);
  results_.erase(found);
}

}  // namespace fxagent
