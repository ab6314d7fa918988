#include "agent/cli/one_shot.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <iostream>
#include <nlohmann/json.hpp>
#include <string_view>
#include <utility>
#include <vector>

#include "agent/cli/command_line_audit.h"
#include "agent/commands/admission.h"
#include "agent/commands/result.h"
#include "agent/commands/result_text.h"
#include "agent/config/reader.h"
#include "agent/field/field.h"
#include "agent/outbox.h"
#include "protocol/plc.h"

namespace fxagent {
namespace {

constexpr int kDone = 0;
constexpr int kDeviceFailed = 1;
constexpr int kWrongQuestion = 2;

Scalar scalar_of(const nlohmann::json& json, const std::string& text) {
  if (json.is_boolean()) return Scalar(json.get<bool>());
  if (json.is_number_integer()) return Scalar(json.get<std::int64_t>());
  if (json.is_number()) return Scalar(json.get<double>());
  if (json.is_string()) return Scalar(json.get<std::string>());
  return Scalar(text);
}

/// `[1,2]`, `true`, `1.5` or `"text"` as JSON; anything else is taken as the text it is.
Value value_of_text(const std::string& text) {
  const auto json = nlohmann::json::parse(text, nullptr, false);
  if (json.is_discarded()) return Value(Scalar(text));
  if (!json.is_array()) return Value(scalar_of(json, text));
  Scalars items;
  for (const auto& item : json) items.push_back(scalar_of(item, item.dump()));
  return Value::array(std::move(items));
}

/// Only the device asked and its link remain.
bool narrow(Config& config, const std::string& name) {
  const auto device = std::find_if(config.devices.begin(), config.devices.end(),
                                   [&](const DeviceConfig& d) { return d.name == name; });
  if (device == config.devices.end()) return false;
  DeviceConfig only = std::move(*device);
  config.links = {config.links[only.link]};
  only.link = 0;
  config.devices.clear();
  config.devices.push_back(std::move(only));
  return true;
}

/// Whether a text that names no tag is meant as one: what is no address of the device, and has
/// neither a digit after at most two letters, as a mistyped address would, nor a colon.
bool is_meant_as_tag(std::string_view text, const AddressSpace& addresses) {
  if (addresses.needs_type(text) || addresses.parse_address(text, std::nullopt)) return false;
  constexpr std::size_t kLettersOfAddress = 2;
  return text.find(':') == text.npos && text.find_first_of("0123456789") > kLettersOfAddress;
}

bool names_tag(const OneShot& what, const DeviceConfig& device) {
  return std::any_of(device.tags.begin(), device.tags.end(),
                     [&](const TagConfig& tag) { return tag.name == what.address; });
}

Command command_for(const OneShot& what, const DeviceConfig& device, CommandTarget target) {
  Command command;
  command.id = "command-line";
  command.op = what.op;
  command.op_text = to_string(what.op);
  command.any_address = true;
  command.received = std::chrono::steady_clock::now();
  command.received_ms = utc_ms(std::chrono::system_clock::now());
  // Standing at the machine, an engineer waits for the answer; the line may be slow to open.
  command.message_expiry = device.commands.max_expiry;
  command.expires_ms =
      command.received_ms + std::chrono::milliseconds(device.commands.max_expiry).count();
  const bool is_tag =
      names_tag(what, device) || is_meant_as_tag(what.address, device.codec->addresses());
  (is_tag ? target.tag : target.address) = what.address;
  command.targets.push_back(std::move(target));
  return command;
}

/// Waits for the field's word; states before it tell what model a device was found to be.
class Answer final {
 public:
  Answer(Outbox& outbox, std::shared_ptr<const Codec> codec)
      : outbox_(outbox), codec_(std::move(codec)) {}

  std::shared_ptr<const Codec> await_model() {
    while (!contacted_) take();
    return codec_;
  }
  CommandResult await_result() {
    while (!result_) take();
    return std::move(*result_);
  }

 private:
  void take() {
    outbox_.wait_until(SteadyTime::max());
    auto batch = outbox_.take();
    for (const DeviceStatus& status : batch.states) {
      if (status.reason != "starting") contacted_ = true;
      if (status.codec) codec_ = status.codec;
    }
    if (!batch.results.empty()) result_ = std::move(batch.results.front());
  }

  Outbox& outbox_;
  std::shared_ptr<const Codec> codec_;
  bool contacted_ = false;
  std::optional<CommandResult> result_;
};

/// To the tenth, which is what a line of any speed lets one see.
double ms(std::chrono::nanoseconds duration) {
  return std::round(std::chrono::duration<double, std::milli>(duration).count() * 10) / 10;
}

/// The call as it was typed, for the audit.
std::string text_of(const OneShot& what) {
  std::string text(to_string(what.op));
  text.append(" ").append(what.device).append(" ").append(what.address);
  if (what.value) text.append(" ").append(*what.value);
  return text;
}

CommandResult not_in_the_audit(const Command& command, std::string why) {
  CommandResult result = result_of(command);
  set_outcome(result, CommandStatus::rejected, Reason::store_unavailable, std::move(why));
  return result;
}

/// Admission and the wire, without a broker and without a journal. `audit` null: there is none.
CommandResult carry_out(const Config& config, const OneShot& what, CommandTarget target,
                        CommandLineAudit* audit) {
  const DeviceConfig& device = config.devices.front();
  const Command command = command_for(what, device, std::move(target));
  if (audit != nullptr && !audit->fault().empty()) return not_in_the_audit(command, audit->fault());
  Outbox outbox(1);
  Field field(config, outbox, {}, Polling::off);
  if (what.trace) field.trace({0});
  field.start();
  Answer answer(outbox, device.codec);
  std::shared_ptr<const Codec> codec = device.codec;
  const bool is_unknown = !command.targets.front().tag.empty() && !names_tag(what, device);
  if (must_ask_model(*codec) && !is_unknown) codec = answer.await_model();
  CommandAdmission admission(device);
  auto decision = admission.admit(command, codec, 0, std::chrono::steady_clock::now());
  if (auto* result = std::get_if<CommandResult>(&decision)) {
    if (audit != nullptr) audit->refused(command, *result, device.name, text_of(what));
    return std::move(*result);
  }
  if (audit != nullptr && !audit->admitted(command, device.name, text_of(what)))
    return not_in_the_audit(command, audit->fault());
  field.submit(std::move(std::get<AdmittedCommand>(decision)));
  CommandResult result = answer.await_result();
  if (audit != nullptr &&
      !audit->finished(result, device.name, utc_ms(std::chrono::system_clock::now())))
    std::cerr << "the result is not in the audit: " << audit->fault() << '\n';
  return result;
}

int exit_status(const CommandResult& result) {
  if (result.status == CommandStatus::succeeded) return kDone;
  return result.status == CommandStatus::rejected ? kWrongQuestion : kDeviceFailed;
}

void print_read(const CommandResult& result, const std::string& device, bool as_json) {
  const bool ok = result.status == CommandStatus::succeeded;
  const TargetResult& target = result.targets.front();
  nlohmann::ordered_json out;
  out["ok"] = ok;
  out["device"] = device;
  out["address"] = target.address;
  if (ok) {
    auto& values = out["values"] = nlohmann::ordered_json::array();
    for (const Scalar& item : target.value->items)
      std::visit([&](const auto& v) { values.push_back(v); }, item);
    out["ms"] = ms(result.wire);
  } else {
    out["reason"] = std::string(to_string(result.reason));
    out["detail"] = result.detail;
  }
  if (as_json) {
    std::cout << out.dump() << '\n';
  } else if (ok) {
    std::cout << device << ' ' << target.address << " =";
    for (const auto& value : out["values"]) std::cout << ' ' << value.dump();
    std::cout << "  (" << ms(result.wire) << " ms)\n";
  } else {
    std::cout << device << ' ' << target.address << ": " << to_string(result.reason) << ": "
              << result.detail << '\n';
  }
}

std::string_view word(PlcAnswer answer) {
  switch (answer) {
    case PlcAnswer::ack:
      return "ACK";
    case PlcAnswer::nak:
      return "NAK";
    default:
      return "no answer";
  }
}

void print_command(const CommandResult& result, const std::string& device, bool as_json) {
  if (as_json) {
    const auto total = std::chrono::steady_clock::now() - result.received;
    std::cout << with_total(result_text(result), total) << '\n';
    return;
  }
  std::cout << device << ' ' << result.op << ' ' << result.targets.front().address << ": "
            << to_string(result.status);
  const bool was_sent = result.status != CommandStatus::rejected;
  if (was_sent) std::cout << ", " << word(result.plc);
  if (result.progress)
    std::cout << ", " << result.progress->done << " of " << result.progress->of << " written";
  if (result.reason != Reason::none) std::cout << ", " << to_string(result.reason);
  if (!result.detail.empty()) std::cout << ": " << result.detail;
  if (was_sent) std::cout << "  (" << ms(result.wire) << " ms)";
  std::cout << '\n';
}

}  // namespace

int run_one_shot(Config config, const OneShot& what) {
  if (!narrow(config, what.device)) {
    std::vector<std::string_view> names;
    for (const DeviceConfig& device : config.devices) names.push_back(device.name);
    std::cerr << "no device " << what.device << " in the config" << did_you_mean(what.device, names)
              << '\n';
    return kWrongQuestion;
  }
  if ((what.type || what.count > 0) && names_tag(what, config.devices.front())) {
    std::cerr << (what.type ? "--type" : "--count") << ": " << what.address
              << " is a tag, the config says its type and count\n";
    return kWrongQuestion;
  }
  CommandTarget target;
  target.count = what.count;
  if (what.value) target.value = value_of_text(*what.value);
  if (what.type) {
    const auto type = data_type_from(*what.type);
    if (!type) {
      std::cerr << "--type: " << type.error().text << '\n';
      return kWrongQuestion;
    }
    target.type = *type;
  }
  std::optional<CommandLineAudit> audit;
  if (what.op != Op::read && !config.store.path.empty())
    audit.emplace(config.store, utc_ms(std::chrono::system_clock::now()));
  const CommandResult result =
      carry_out(config, what, std::move(target), audit ? &*audit : nullptr);
  if (what.op == Op::read)
    print_read(result, what.device, what.as_json);
  else
    print_command(result, what.device, what.as_json);
  return exit_status(result);
}

}  // namespace fxagent
