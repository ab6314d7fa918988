#include "agent/commands/admission.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "agent/commands/parse/parse.h"
#include "agent/commands/result.h"
#include "agent/config/suggestions.h"
#include "protocol/plan/plan.h"
#include "protocol/plc.h"
#include "protocol/value/pack.h"
#include "protocol/value/raw.h"
#include "protocol/value/value.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;

// An admitted command takes at most this many times the memory of the command as received: the
// values bound its images and requests.
constexpr std::size_t kAdmittedToCommand = 2;

bool is_write(Op op) { return op == Op::write || op == Op::force_on || op == Op::force_off; }
bool is_run_or_stop(Op op) { return op == Op::run || op == Op::stop; }

Refusal refuse(Reason reason, std::string detail) { return {reason, std::move(detail)}; }

/// Returns a limit of the tag as a device stores it, if the tag is a float: its raw value is
/// rounded, too, and a command may write the limit itself.
std::optional<double> stored(const TagConfig& tag, std::optional<double> limit) {
  if (!limit || !is_float(tag.point.type)) return limit;
  Point one = tag.point;
  one.is_array = false;
  one.count = 1;
  const auto image = pack(one, Value(Scalar(*limit)));
  if (!image) return limit;
  const auto value = unpack(one, *image, span_of(one)->first_bit);
  return value ? as_double(value->items.front()) : limit;
}

/// Returns a refusal if an element to be written is outside the tag's min and max.
std::optional<Refusal> check_limits(const TagConfig& tag, const Value& written) {
  const auto& [min, max, deadband] = tag.units->limits;
  auto least = stored(tag, min);
  auto most = stored(tag, max);
  if (tag.point.scaled() && !is_float(tag.point.type)) {
    // raw × scale + offset may differ from the limit in the last digit.
    const double nearly_nothing = std::abs(tag.point.scale) * 1e-5;
    if (least) *least -= nearly_nothing;
    if (most) *most += nearly_nothing;
  }
  for (const Scalar& item : written.items) {
    if (!number_of(item)) continue;
    const std::string what = spelled(item) + " would be written, ";
    if (least && compare(item, *least) == std::partial_ordering::less)
      return refuse(Reason::out_of_range, what + "below the tag's min of " + spelled(*min));
    if (most && compare(item, *most) == std::partial_ordering::greater)
      return refuse(Reason::out_of_range, what + "above the tag's max of " + spelled(*max));
  }
  return std::nullopt;
}

std::uint16_t small_count(std::size_t count) {
  return static_cast<std::uint16_t>(std::clamp<std::size_t>(count, 1, 0xFFFF));
}

std::size_t characters_in(std::string_view utf8) {
  return static_cast<std::size_t>(std::count_if(utf8.begin(), utf8.end(), [](char c) {
    return (static_cast<unsigned char>(c) & 0xC0) != 0x80;
  }));
}

/// Sets the number of elements or characters of an address without a tag: as many as the value has,
/// or as a read asks for.
void set_extent(const CommandTarget& target, Point& point) {
  const bool has_value = target.value && !target.value->items.empty();
  if (point.type == DataType::string) {
    const auto* text = has_value ? std::get_if<std::string>(target.value->items.data()) : nullptr;
    point.length = small_count(text != nullptr ? characters_in(*text) : target.count);
  } else if (has_value && target.value->is_array) {
    point.is_array = true;
    point.count = small_count(target.value->items.size());
  } else if (target.count > 1) {
    point.is_array = true;
    point.count = target.count;
  }
}

/// Returns when the command stops being fresh. Both expiries are relative to the clock at receipt.
SteadyTime deadline_of(const Command& command, const CommandRules& rules) {
  SteadyTime deadline = command.received + rules.default_expiry;
  if (command.expires_ms) {
    // The age of an expired command does not matter, and may be more than a duration can hold.
    const auto fresh_from = std::max(*command.expires_ms, command.received_ms - 1);
    deadline = command.received + milliseconds(fresh_from - command.received_ms);
  }
  if (command.message_expiry)
    deadline = std::min(deadline, command.received + *command.message_expiry);
  return deadline;
}

std::optional<Refusal> check_expiry(const Command& command, const CommandRules& rules) {
  if (!command.expires_ms) return std::nullopt;
  const auto latest = command.received_ms + milliseconds(rules.max_expiry).count();
  if (*command.expires_ms <= latest) return std::nullopt;
  return refuse(Reason::bad_value,
                "expires is more than max_expiry_s (" + std::to_string(rules.max_expiry.count()) +
                    " s) ahead of this agent's clock: one of the clocks is wrong");
}

std::string why_expired(const Command& command) {
  constexpr std::int64_t in_1973_ms = 100'000'000'000;  // the number of a year to come, in seconds
  std::string text = "the command had expired when it arrived";
  if (command.expires_ms && *command.expires_ms < in_1973_ms)
    text += "; expires is in milliseconds since 1970";
  else if (command.expires_ms && *command.expires_ms < command.received_ms)
    text += ", " + std::to_string(command.received_ms - *command.expires_ms) +
            " ms ago by this agent's clock";
  return text;
}

/// Returns why the PLC must not be switched; otherwise sets the request that switches it.
std::optional<Refusal> prepare_run_or_stop(const Codec& codec, const CommandRules& rules, Op op,
                                           std::optional<Request>& request) {
  const PlcServices* plc = codec.plc();
  if (plc == nullptr) return refuse(Reason::bad_op, "this protocol has no run and stop");
  if (!rules.allow_run_stop)
    return refuse(Reason::not_allowed, "allow_run_stop is not set for this device");
  request = plc->run_request(op == Op::run);
  if (const auto frame = codec.encode(*request, 0); !frame)
    return refuse(Reason::bad_op, frame.error().text);
  return std::nullopt;
}

/// Returns "; did you mean …?", or empty if no name is near or the device has more than 1,000 tags.
std::string nearest_tag(std::string_view said, const DeviceConfig& device) {
  constexpr std::size_t kMost = 1000;
  return device.tags.size() > kMost ? std::string() : did_you_mean(said, names_in(device.tags));
}

/// Returns the detail for a point that was given by its address, outside of commands.allow. Names a
/// tag of this address, through which the command would be admitted.
std::string why_not_allowed(const AddressSpace& addresses, const DeviceConfig& device, Op op,
                            const Point& point) {
  const Span span = *span_of(point);
  std::string text = "commands.allow does not cover ";
  text += span == point.address.span ? std::string(point.address.text) : names_of(addresses, span);
  const auto tag = std::ranges::find_if(device.tags, [&](const TagConfig& each) {
    return each.point == point && (op == Op::read || each.writable);
  });
  if (tag != device.tags.end())
    text += "; the tag " + std::string(tag->name) + " has this address: name the tag instead";
  return text;
}

/// Returns "TN5" or "TS5" for T5.
std::string with_letter(std::string address, char letter) {
  address.insert(std::min(address.find_first_of("0123456789"), address.size()), 1, letter);
  return address;
}

}  // namespace

CommandAdmission::Decision CommandAdmission::admit(Command command,
                                                   const std::shared_ptr<const Codec>& device_codec,
                                                   std::size_t waiting, SteadyTime now) {
  const Codec& codec = *device_codec;
  const CommandRules& rules = device_->commands;
  CommandResult result = result_of(command);
  const auto rejected = [&](const Command& what, Refusal why) {
    result.status = CommandStatus::rejected;
    result.reason = why.reason;
    result.detail = std::move(why.detail);
    remember_refused(what, result, now);
    return result;
  };

  // An id that was seen gets no second decision, whatever is wrong with this message. The other
  // promises rest on exactly one result that is not DUPLICATE.
  if (!command.id.empty()) {
    if (const auto seen = ids_.find(command.id, now)) {
      set_outcome(result, CommandStatus::duplicate, Reason::duplicate_id, {});
      if (!seen->over)
        result.detail = "the command is not finished and has no result yet; it is not repeated";
      else if (!seen->number || (!seen->result && !shared_->is_journaled))
        result.detail = "the command is over and its result is no longer kept; it is not repeated";
      else
        result.first_number = seen->number;
      if (seen->result) {
        result.first = std::make_shared<const CommandResult>(recorded_result(*seen->result));
        result.plc = result.first->plc;
      }
      return result;
    }
  }
  const std::optional<Refusal> refusal = command.refusal;
  if (refusal && refusal->reason < Reason::duplicate_id) return rejected(command, *refusal);
  AdmittedCommand admitted;
  admitted.codec = device_codec;
  std::optional<Refusal> why;
  if (command.retained) {
    why = refusal_of_retained();
  } else if (refusal && refusal->reason == Reason::bad_op) {
    why = refusal;
  } else if (!command.op) {
    why = refuse(Reason::bad_op, "op must be one of " + std::string(command.ops));
  } else if (is_run_or_stop(*command.op)) {
    why = prepare_run_or_stop(codec, rules, *command.op, admitted.run_request);
  }
  admitted.command = std::move(command);
  const Command& cmd = admitted.command;
  if (!why && !is_run_or_stop(*cmd.op)) why = resolve(codec, admitted, result.targets);
  Faults faults;
  faults.add(std::move(why));
  faults.add(refusal);
  faults.add(check_expiry(cmd, rules));
  why = faults.first();

  admitted.deadline = now;
  if (!why) {
    admitted.deadline = deadline_of(cmd, rules);
    if (now > admitted.deadline) {
      set_outcome(result, CommandStatus::expired, Reason::expired, why_expired(cmd));
      remember_refused(cmd, result, now);
      return result;
    }
    why = take_room(cmd, waiting, admitted.place, now);
    if (!why && !shared_->conflict.empty()) why = refusal_of_conflict(shared_->conflict);
  }
  if (why) return rejected(cmd, *why);
  if (cmd.dry_run) {
    set_outcome(result, CommandStatus::succeeded, Reason::none, {});
    return result;
  }
  if (shared_->is_stopping || is_reloading_) {
    const Reason closed = shared_->is_stopping ? Reason::shutting_down : Reason::reloading;
    set_outcome(result, CommandStatus::rejected, closed, why_not_sent(closed));
    remember_refused(cmd, result, now);
    return result;
  }
  ids_.add({cmd.id, cmd.number, now, admitted.deadline}, now);
  admitted.verify_words = cmd.verify.value_or(rules.verify);
  admitted.verify_bits = cmd.verify.value_or(false);
  return admitted;
}

std::optional<Refusal> CommandAdmission::take_room(const Command& command, std::size_t waiting,
                                                   SharedAdmission::Place& place, SteadyTime now) {
  if (waiting >= device_->commands.queue)
    return refuse(Reason::queue_full,
                  std::to_string(waiting) + " commands are waiting for this device");
  place = shared_->take(command.device, kAdmittedToCommand * memory_of(command));
  if (!place)
    return refuse(Reason::queue_full, "the waiting commands already take " +
                                          std::to_string(shared_->bytes() >> 20) + " MiB");
  if (!ids_.make_room(now))
    return refuse(Reason::queue_full,
                  "the memory of command ids is full, and no id in it has expired");
  return std::nullopt;
}

std::optional<Refusal> CommandAdmission::resolve(const Codec& codec, AdmittedCommand& admitted,
                                                 std::vector<TargetResult>& out) {
  const Command& command = admitted.command;
  if (command.targets.empty()) {
    const Reason fault = command.refusal ? command.refusal->reason : Reason::none;
    if (fault == Reason::unknown_tag || fault == Reason::bad_address) return command.refusal;
    return refuse(Reason::unknown_tag, "neither tag nor address");
  }
  Faults faults;
  for (std::size_t i = 0; i < command.targets.size(); ++i) {
    AdmittedTarget target;
    auto why = resolve_target(codec, command, command.targets[i], target);
    if (!target.point.address.text.empty()) out[i].address = target.point.address.text;
    if (why) {
      out[i].reason = why->reason;
      out[i].detail = why->detail;
      faults.add(std::move(why));
    }
    if (target.written) out[i].value = target.written;
    admitted.targets.push_back(std::move(target));
  }
  const std::optional<Refusal>& first = faults.first();
  if (first && command.is_list)
    for (TargetResult& target : out)
      if (target.reason == Reason::none)
        target.detail = "not sent: the agent refused another target";
  return first;
}

std::optional<Refusal> CommandAdmission::resolve_target(const Codec& codec, const Command& command,
                                                        const CommandTarget& target,
                                                        AdmittedTarget& out) const {
  Faults faults;
  faults.add(target.fault);
  if (auto why = resolve_place(codec, *command.op, target, out))
    faults.add(std::move(why));
  else
    faults.add(check_access(codec, command, out));
  if (!faults.first() && is_write(*command.op)) return check_value(codec, command, target, out);
  return faults.first();
}

std::optional<Refusal> CommandAdmission::resolve_place(const Codec& codec, Op op,
                                                       const CommandTarget& target,
                                                       AdmittedTarget& out) const {
  out.tag = target.tag;
  const Reason fault = target.tag.empty() ? Reason::bad_address : Reason::unknown_tag;
  if (!target.tag.empty()) {
    const auto tag = std::find_if(device_->tags.begin(), device_->tags.end(),
                                  [&](const TagConfig& t) { return t.name == target.tag; });
    if (tag == device_->tags.end())
      return refuse(fault, "device " + device_->name + " has no tag " + target.tag +
                               nearest_tag(target.tag, *device_));
    out.tag_index = static_cast<std::uint32_t>(tag - device_->tags.begin());
    out.point = tag->point;
  } else {
    if (!target.type && codec.addresses().needs_type(target.address))
      return refuse(fault, target.address + " is both a contact and a value: write " +
                               with_letter(target.address, 'S') + " for the contact, " +
                               with_letter(target.address, 'N') + " for the value, or set type");
    const auto address = codec.addresses().parse_address(target.address, target.type);
    if (!address) return refuse(fault, address.error().text);
    out.point.address = *address;
    out.point.type = target.type.value_or(default_type(*address));
    out.point.order = codec.addresses().default_order();
    set_extent(target, out.point);
  }
  if (target.order) out.point.order = *target.order;
  const auto span = span_of(out.point);
  if (!span) return refuse(Reason::bad_address, span.error().text);
  if (const auto inside = codec.addresses().check_range(*span); !inside)
    return refuse(Reason::bad_address, inside.error().text);
  if (auto why = check_model(codec, *span)) return why;
  const Address& place = out.point.address;
  const bool is_bit = !out.point.is_array &&
                      (place.unit == Unit::bit || (place.unit == Unit::word_bit && place.writable));
  if ((op == Op::force_on || op == Op::force_off) && !is_bit)
    return refuse(
        Reason::bad_address,
        (target.tag.empty() ? "" : "the tag " + target.tag + " at ") + place.text +
            " is not a single bit device" +
            (out.point.is_array ? ": its count is " + std::to_string(out.point.count) : ""));
  if (codec.is_broadcast()) {
    if (op != Op::read) return std::nullopt;
    return refuse(fault, "no device answers a broadcast, so nothing can be read");
  }
  const Plan plan =
      make_plan(codec, std::span(&out.point, 1), LineCost{}, device_->max_block_bytes);
  if (!plan.unreachable.empty())
    return refuse(Reason::bad_address,
                  out.point.address.text + " cannot be reached with this model" +
                      (must_ask_model(codec) ? " before the model is known" : ""));
  return std::nullopt;
}

std::optional<Refusal> CommandAdmission::check_model(const Codec& codec, const Span& span) const {
  if (codec_of_plc_ == nullptr) return std::nullopt;
  const std::string name = names_of(codec.addresses(), span);
  const std::string on_plc = names_of(codec_of_plc_->addresses(), span);
  if (name == on_plc) return std::nullopt;
  return refuse(Reason::bad_address, name + " is " + on_plc + " on this PLC: it is an " +
                                         model_of(*codec_of_plc_) + ", but the config says " +
                                         model_of(codec) + "; correct model, or set it to auto");
}

std::optional<Refusal> CommandAdmission::check_access(const Codec& codec, const Command& command,
                                                      const AdmittedTarget& target) const {
  const Span span = *span_of(target.point);
  const bool allowed = is_covered(span, device_->commands.allow);
  const auto not_allowed = [&] {
    return refuse(Reason::not_allowed,
                  why_not_allowed(codec.addresses(), *device_, *command.op, target.point));
  };
  if (*command.op == Op::read) {
    if (target.tag_index || allowed || command.any_address) return std::nullopt;
    return not_allowed();
  }
  if (!target.point.address.writable)
    return refuse(Reason::not_writable, std::string(target.point.address.text) + " is read only");
  const auto writable = codec.addresses().check_write(span);
  if (target.tag_index && !device_->tags[*target.tag_index].writable)
    return refuse(Reason::not_writable,
                  "the tag's access is read" +
                      (writable ? "; with \"access\": \"read_write\" in the config, commands may "
                                  "write it"
                                : ", and " + writable.error().text));
  if (!writable) return refuse(Reason::not_writable, writable.error().text);
  if (target.tag_index || allowed) return std::nullopt;
  return not_allowed();
}

std::optional<Refusal> CommandAdmission::check_value(const Codec& codec, const Command& command,
                                                     const CommandTarget& target,
                                                     AdmittedTarget& out) const {
  const std::optional<Value> value =
      *command.op == Op::write ? target.value : Value(Scalar(*command.op == Op::force_on));
  if (!value) return refuse(Reason::bad_value, "value is missing");
  const auto packed = pack(out.point, *value);
  if (!packed && packed.error().fault == PackFault::bad_value)
    return refuse(Reason::bad_value, packed.error().text);
  if (command.expect) {
    if (codec.is_broadcast())
      return refuse(Reason::bad_value,
                    "expect: no device answers a broadcast, so there is nothing to compare");
    if (const auto kind = check_kind(out.point, *command.expect); !kind)
      return refuse(Reason::bad_value, "expect: " + kind.error().text);
    out.expected = command.expect;
  }
  const auto check_limits_of_tag = [&](const Value& written) {
    return out.tag_index ? check_limits(device_->tags[*out.tag_index], written) : std::nullopt;
  };
  if (!packed) {
    // The tag's own limit says more than the range of its type, which names the element of an
    // array.
    auto why = value->is_array ? std::nullopt : check_limits_of_tag(*value);
    return why ? why : refuse(Reason::out_of_range, packed.error().text);
  }
  const auto written = unpack(out.point, *packed, span_of(out.point)->first_bit);
  if (!written) return refuse(Reason::out_of_range, written.error().text);
  if (auto why = check_limits_of_tag(*written)) return why;
  const auto requests = plan_write(codec, out.point, *packed);
  if (!requests) return refuse(Reason::not_writable, requests.error().text);
  for (const Request& request : *requests)
    if (const auto frame = codec.encode(request, 0); !frame)
      return refuse(Reason::bad_address, frame.error().text);
  out.image = *packed;
  out.requests = *requests;
  out.written = *written;
  return std::nullopt;
}

void CommandAdmission::remember_refused(const Command& command, CommandResult& result,
                                        SteadyTime now) {
  if (command.dry_run || command.id.empty()) return;
  keep(result, SharedAdmission::ResultOf::refused);
  ids_.add_refused({command.id, command.number, now, now, true, result.kept}, now);
}

void CommandAdmission::finished(CommandResult& result) {
  keep(result, SharedAdmission::ResultOf::admitted);
  ids_.finish(result.id, result.kept);
}

void CommandAdmission::keep(CommandResult& result, SharedAdmission::ResultOf command) {
  if (!shared_->is_journaled) result.kept = shared_->keep(result_text(result), command);
}

void CommandAdmission::restore(const KnownId& known, SteadyTime now, std::int64_t utc_ms) {
  // A clock that was set back must neither make an id younger than it can be nor extend its
  // deadline.
  const std::int64_t age = std::max<std::int64_t>(utc_ms - known.received_ms, 0);
  const std::int64_t left =
      std::min(known.deadline_ms - utc_ms, known.deadline_ms - known.received_ms);
  IdMemory::Entry entry{known.id, known.number, now - milliseconds(age), now + milliseconds(left),
                        true};
  if (known.refused)
    ids_.add_refused(std::move(entry), now);
  else
    ids_.add(std::move(entry), now);
}

std::optional<AdmittedCommand> CommandAdmission::interrupted(
    Command command, const std::shared_ptr<const Codec>& codec, SteadyTime now) {
  ids_.add({command.id, command.number, command.received, deadline_of(command, device_->commands)},
           now);
  std::vector<TargetResult> names = result_of(command).targets;
  AdmittedCommand admitted;
  admitted.command = std::move(command);
  admitted.codec = codec;
  admitted.interrupted = true;
  admitted.deadline = now;
  if (codec->is_broadcast() || resolve(*codec, admitted, names)) return std::nullopt;
  if (std::ranges::any_of(admitted.targets, [](const AdmittedTarget& target) {
        return target.point.type == DataType::boolean;
      }))
    return std::nullopt;
  return admitted;
}

}  // namespace fxagent
