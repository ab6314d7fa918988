#include "agent/cli/subcommands.h"

#include <algorithm>
#include <chrono>
#include <csignal>
#include <iostream>
#include <nlohmann/json.hpp>
#include <string_view>
#include <tuple>
#include <utility>
#include <vector>

#include "agent/cli/audit/command_line_audit.h"
#include "agent/cli/exit_status.h"
#include "agent/cli/report/layout.h"
#include "agent/cli/report/read_report.h"
#include "agent/commands/admission.h"
#include "agent/commands/result.h"
#include "agent/config/suggestions.h"
#include "agent/field/field.h"
#include "agent/handover/outbox.h"
#include "agent/log/log.h"
#include "agent/text/json.h"
#include "agent/text/json_writer.h"
#include "protocol/plc.h"
#include "protocol/value/pack.h"
#include "protocol/value/value.h"

namespace fxagent {
namespace {

/// Parses `[1,2]`, `true`, `1.5` or `"text"` as JSON; any other text becomes a string.
Value value_of_text(const std::string& text) {
  const auto json = parsed_json(text);
  if (json.is_discarded() || !vanishing_number(text).empty()) return Value(Scalar(text));
  if (!json.is_array()) return Value(scalar_of(json).value_or(Scalar(text)));
  Scalars items;
  for (const auto& item : json) items.push_back(scalar_of(item).value_or(Scalar(dumped(item))));
  return Value::array(std::move(items));
}

/// Reduces the config to one device and its link. Returns false if the device does not exist.
bool narrow(Config& config, const std::string& name) {
  const auto device = std::ranges::find(config.devices, name, &DeviceConfig::name);
  if (device == config.devices.end()) return false;
  DeviceConfig only = std::move(*device);
  config.links = {config.links[only.link]};
  only.link = 0;
  config.devices.clear();
  config.devices.push_back(std::move(only));
  return true;
}

/// True if an unknown name was meant as a tag and not as a mistyped address. It is not a valid
/// address of the device, has no colon, and has no digit within its first three characters.
bool is_meant_as_tag(std::string_view text, const AddressSpace& addresses) {
  if (addresses.needs_type(text) || addresses.parse_address(text, std::nullopt)) return false;
  constexpr std::size_t kLettersOfAddress = 2;
  return text.find(':') == text.npos && text.find_first_of("0123456789") > kLettersOfAddress;
}

const TagConfig* tag_named(const std::string& name, const DeviceConfig& device) {
  const auto found = std::ranges::find(device.tags, name, &TagConfig::name);
  return found == device.tags.end() ? nullptr : &*found;
}

/// Builds a command. `target` has neither tag nor address; `name` is either.
Command command_for(Op op, const std::string& name, const DeviceConfig& device,
                    CommandTarget target) {
  Command command;
  command.id = "command-line";
  command.op = op;
  command.op_text = to_string(op);
  command.any_address = true;
  command.received = std::chrono::steady_clock::now();
  command.received_ms = utc_now_ms();
  // The longest expiry: an engineer at the machine waits for the answer, and the link may be slow
  // to open.
  command.message_expiry = device.commands.max_expiry;
  command.expires_ms =
      command.received_ms + std::chrono::milliseconds(device.commands.max_expiry).count();
  const bool is_tag =
      tag_named(name, device) != nullptr || is_meant_as_tag(name, device.codec->addresses());
  (is_tag ? target.tag : target.address) = name;
  command.targets.push_back(std::move(target));
  return command;
}

CommandResult not_in_the_audit(const Command& command, std::string why) {
  CommandResult result = result_of(command);
  set_outcome(result, CommandStatus::rejected, Reason::store_unavailable, std::move(why));
  return result;
}

// Longest time to open a link: that of a TCP connection.
constexpr std::chrono::seconds kOpenWithin{5};
// A device that did not answer, or whose answer was damaged, is asked again within this time.
constexpr std::chrono::seconds kAskedAgainWithin{1};

/// Admission and bus access for the first device of a config, without broker and journal.
class DirectLine final {
 public:
  DirectLine(const Config& config, bool trace)
      : device_(config.devices.front()),
        listening_(config.links.front().listening),
        outbox_(1),
        field_(config, outbox_, {}, Polling::off),
        codec_(device_.codec) {
    if (trace) field_.trace({0});
    field_.start();
  }

  const DeviceConfig& device() const { return device_; }
  const Codec& codec() const { return *codec_; }

  /// Executes one command. `audit` records it; null: no record.
  CommandResult carry_out(Op op, const std::string& name, CommandTarget target,
                          CommandLineAudit* audit = nullptr) {
    const bool is_unknown =
        tag_named(name, device_) == nullptr && is_meant_as_tag(name, device_.codec->addresses());
    const bool is_compared = op != Op::read && codec_->plc() != nullptr;
    if ((must_ask_model(*codec_) || is_compared) && !is_unknown) await_contact();
    const Command command = command_for(op, name, device_, std::move(target));  // expires from now
    CommandAdmission admission(device_);
    if (is_compared) admission.plc_has(codec_of_plc_);
    auto decision = admission.admit(command, codec_, 0, std::chrono::steady_clock::now());
    if (auto* result = std::get_if<CommandResult>(&decision)) {
      if (audit != nullptr && !audit->refused(command, *result))
        std::cerr << "the refusal is not in the audit: " << audit->fault() << '\n';
      return std::move(*result);
    }
    if (audit != nullptr && !audit->admitted(command))
      return not_in_the_audit(command, audit->fault());
    field_.submit(std::move(std::get<AdmittedCommand>(decision)));
    while (!result_) take(SteadyTime::max());
    CommandResult result = *std::exchange(result_, std::nullopt);
    if (audit != nullptr && !audit->finished(result, utc_now_ms()))
      std::cerr << "the result is not in the audit: " << audit->fault() << '\n';
    return result;
  }

 private:
  /// Waits until the PLC was asked for its model, or does not answer. A device that sends only
  /// invalid answers has no state.
  void await_contact() {
    using Clock = std::chrono::steady_clock;
    auto until = Clock::now() + kOpenWithin + listening_ + 3 * device_.timeout;
    while (!is_alive_ && Clock::now() < until) {
      if (was_offline_)
        until = std::min(until, Clock::now() + kAskedAgainWithin + 2 * device_.timeout);
      take(until);
    }
  }
  /// Waits for messages of the field. States that arrive before the result carry the detected
  /// model.
  void take(SteadyTime until) {
    outbox_.wait_until(until);
    auto batch = outbox_.take();
    for (const DeviceStatus& status : batch.states) {
      is_alive_ |= status.is_alive();
      was_offline_ |= !status.is_alive() && status.reason != "starting";
      if (status.codec && must_ask_model(*codec_)) codec_ = status.codec;
      codec_of_plc_ = status.codec_of_plc;
    }
    if (!batch.results.empty()) result_ = std::move(batch.results.front());
  }

  const DeviceConfig& device_;
  const std::chrono::milliseconds listening_;
  Outbox outbox_;
  Field field_;
  std::shared_ptr<const Codec> codec_;
  std::shared_ptr<const Codec> codec_of_plc_;  ///< DeviceStatus::codec_of_plc
  bool is_alive_ = false;
  bool was_offline_ = false;  ///< after the start
  std::optional<CommandResult> result_;
};

/// Returns the call as typed, for the audit.
std::string text_of(const OneShot& what) {
  std::string text(to_string(what.op));
  text.append(" ").append(what.device).append(" ").append(what.names.front());
  if (what.value) text.append(" ").append(*what.value);
  return text;
}

int exit_status(const CommandResult& result) {
  if (result.status == CommandStatus::succeeded) return kDone;
  return result.status == CommandStatus::rejected ? kWrong : kFailed;
}

/// Returns the address of the only target; `name`, as the caller gave it, if it is not known.
std::string address_or(const CommandResult& result, const std::string& name) {
  const std::string& address = result.targets.front().address;
  return address.empty() ? name : address;
}

void print_address(const CommandResult& result, const OneShot& what) {
  const bool ok = result.status == CommandStatus::succeeded;
  const std::string address = address_or(result, what.names.front());
  const TargetResult& target = result.targets.front();
  nlohmann::ordered_json out;
  out["ok"] = ok;
  out["device"] = what.device;
  out["address"] = address;
  if (ok) {
    json::Writer values;
    json::write_value(values, Value::array(target.value->items));
    out["values"] = parsed_ordered_json(values.take());
    out["ms"] = rounded_ms(result.wire);
  } else {
    out["reason"] = std::string(to_string(result.reason));
    out["detail"] = result.detail;
  }
  if (what.as_json) {
    std::cout << dumped(out) << '\n';
  } else if (ok) {
    std::cout << what.device << ' ' << address << " =";
    for (const Scalar& item : target.value->items)
      std::cout << ' ' << value_text(Value(item), *no_units());
    std::cout << "  (" << rounded_ms(result.wire) << " ms)\n";
  } else {
    std::cout << what.device << ' ' << address << ": " << to_string(result.reason) << ": "
              << result.detail << '\n';
  }
}

void print_command(const CommandResult& result, const OneShot& what) {
  if (what.as_json) {
    const auto total = std::chrono::steady_clock::now() - result.received;
    std::cout << with_total(result_text(result), total) << '\n';
    return;
  }
  std::cout << what.device << ' ' << result.op << ' ' << address_or(result, what.names.front())
            << ": " << to_string(result.status);
  const bool was_sent = result.wire.count() > 0;
  if (!was_sent && result.status != CommandStatus::rejected) std::cout << ", nothing was sent";
  if (was_sent)
    std::cout << ", " << (result.plc == PlcAnswer::none ? "no answer" : to_string(result.plc));
  if (result.progress)
    std::cout << ", " << result.progress->done << " of " << result.progress->of << " written";
  if (result.reason != Reason::none) std::cout << ", " << to_string(result.reason);
  if (!result.detail.empty()) std::cout << ": " << result.detail;
  const auto& verify = result.targets.front().verify;
  if (verify && verify->read) std::cout << ", read back " << value_text(*verify->read, *no_units());
  if (was_sent) std::cout << "  (" << rounded_ms(result.wire) << " ms)";
  std::cout << '\n';
}

/// Warns if the device stored a rounded value.
void warn_of_rounding(const CommandResult& result, const std::optional<Value>& asked) {
  const auto& written = result.targets.front().value;
  if (!asked || !written || result.status == CommandStatus::rejected || shows(*written, *asked))
    return;
  std::cerr << "rounded: " << value_text(*asked, *no_units()) << " was requested, "
            << value_text(*written, *no_units()) << " was written\n";
}

// ---- read -------------------------------------------------------------------------------------

/// Returns the point of a tag or an address, as its command will use it; nullopt if it is rejected.
std::optional<Point> point_of(const std::string& name, const CommandTarget& target,
                              const DeviceConfig& device, const Codec& codec) {
  Point point;
  if (const TagConfig* tag = tag_named(name, device)) {
    point = tag->point;
  } else {
    const auto address = codec.addresses().parse_address(name, target.type);
    if (!address) return std::nullopt;
    point = {.address = *address,
             .type = target.type.value_or(default_type(*address)),
             .order = codec.addresses().default_order(),
             .count = std::max<std::uint16_t>(target.count, 1),
             .is_array = target.count > 1};
  }
  point.order = target.order.value_or(point.order);
  return point;
}

/// Reads `count` words from `address` on, unconverted, as the image that unpack() takes. The image
/// is empty if the result is no success.
std::pair<CommandResult, Bytes> read_words(DirectLine& line, const Address& address,
                                           std::uint32_t count) {
  // Not the caller's point: its scale and offset do not hold for single words.
  const Point words{.address = address,
                    .type = DataType::uint16,
                    .order = ByteOrder::abcd,  // the bytes of a word unchanged
                    .count = static_cast<std::uint16_t>(count),
                    .is_array = true};
  CommandTarget target;
  target.type = words.type;
  target.order = words.order;
  target.count = words.count;
  CommandResult result = line.carry_out(Op::read, std::string(address.text), std::move(target));
  Bytes image;
  if (auto& value = result.targets.front().value) {
    if (!value->is_array) value = Value::array(std::move(value->items));
    if (auto packed = pack(words, *value))
      image = std::move(*packed);
    else
      set_outcome(result, CommandStatus::failed, Reason::bad_value, packed.error().text);
  }
  return {std::move(result), std::move(image)};
}

/// Reads the point as plain words, so that its value can be shown in every word order.
CommandResult read_by_words(DirectLine& line, const Point& point, Bytes& image) {
  CommandResult result;
  std::tie(result, image) = read_words(line, point.address, span_of(point)->bits / kWordBits);
  auto& value = result.targets.front().value;
  value.reset();
  if (image.empty()) return result;
  if (auto read = in_order(point, image, point.order))
    value = std::move(*read);
  else
    set_outcome(result, CommandStatus::failed, Reason::bad_value, read.error().text);
  return result;
}

/// Reads one tag or address into `report`. `target` is as the caller gave it; for a tag it has
/// neither type nor count (see call_fault()).
CommandResult read_one(DirectLine& line, const std::string& name, const CommandTarget& target,
                       ReadReport& report) {
  report.name = name;
  if (const TagConfig* tag = tag_named(name, line.device())) report.units = tag->units;
  const auto point = point_of(name, target, line.device(), line.codec());
  if (point && has_word_order(*point)) report.point = point;
  report.orders = word_orders(*line.device().protocol);
  CommandResult result = report.point ? read_by_words(line, *report.point, report.image)
                                      : line.carry_out(Op::read, name, target);
  const TargetResult& out = result.targets.front();
  report.address = out.address;
  report.reason = to_string(result.reason);
  report.detail = result.detail;
  if (result.status == CommandStatus::succeeded) report.value = out.value;
  return result;
}

/// True if the device does not answer: reading more tags would only cost more time-outs.
bool is_silent(const CommandResult& result) {
  return result.reason == Reason::timeout || result.reason == Reason::device_offline ||
         result.reason == Reason::link_down;
}

/// Returns the address if it names a word and `--orders` is to show the 32- and 64-bit values that
/// begin there: it is not a tag and the caller named no type.
std::optional<Address> untyped_word(const DirectLine& line, const std::string& name,
                                    const CommandTarget& target) {
  if (target.type || tag_named(name, line.device()) != nullptr) return std::nullopt;
  const auto address = line.codec().addresses().parse_address(name, std::nullopt);
  return address && address->unit == Unit::word ? std::optional(*address) : std::nullopt;
}

/// Reads `target.count` words from `address` on and adds a report for each 32- and 64-bit type.
/// Without a count, one value of each type: of 32 bits only if four words cannot be read.
CommandResult read_every_type(DirectLine& line, const std::string& name, const Address& address,
                              const CommandTarget& target, std::vector<ReadReport>& reports) {
  const bool is_counted = target.count > 1;
  auto [result, image] = read_words(line, address, is_counted ? target.count : 4);
  if (image.empty() && !is_counted && !is_silent(result))
    std::tie(result, image) = read_words(line, address, 2);
  ReadReport read{.name = name,
                  .address = std::string(address.text),
                  .orders = word_orders(*line.device().protocol)};
  if (image.empty()) {
    read.reason = to_string(result.reason);
    read.detail = result.detail;
    reports.push_back(std::move(read));
    return std::move(result);
  }
  read.image = std::move(image);
  for (const DataType type : {DataType::int32, DataType::uint32, DataType::float32, DataType::int64,
                              DataType::uint64, DataType::float64}) {
    Point point{.address = address,
                .type = type,
                .order = target.order.value_or(line.codec().addresses().default_order())};
    const auto one = span_of(point)->bits / 8;
    const auto fitting = read.image.size() / one;
    if (fitting == 0) continue;
    point.is_array = is_counted && fitting > 1;
    point.count = static_cast<std::uint16_t>(point.is_array ? fitting : 1);
    ReadReport& report = reports.emplace_back(read);
    report.point = point;
    if (auto value = in_order(point, report.image, point.order)) {
      report.value = std::move(*value);
    } else {
      report.reason = to_string(Reason::bad_value);
      report.detail = value.error().text;
    }
  }
  return std::move(result);
}

int run_reads(DirectLine& line, const OneShot& what, const CommandTarget& target) {
  std::vector<std::string> names = what.names;
  if (names.empty())
    for (const TagConfig& tag : line.device().tags) names.emplace_back(std::string_view(tag.name));
  std::vector<ReadReport> reports;
  int status = kDone;
  std::chrono::nanoseconds wire{0};
  for (const std::string& name : names) {
    const auto word = what.orders ? untyped_word(line, name, target) : std::nullopt;
    const CommandResult result = word ? read_every_type(line, name, *word, target, reports)
                                      : read_one(line, name, target, reports.emplace_back());
    status = std::max(status, exit_status(result));
    wire += result.wire;
    if (is_silent(result)) break;
  }
  const ShowOrders orders = what.orders ? ShowOrders::yes : ShowOrders::no;
  if (what.as_json)
    std::cout << read_json(what.device, reports, orders, rounded_ms(wire)) << '\n';
  else
    std::cout << read_table(reports, orders);
  return status;
}

int run_read(DirectLine& line, const OneShot& what, const CommandTarget& target) {
  const bool is_one_address =
      what.names.size() == 1 && tag_named(what.names.front(), line.device()) == nullptr;
  if (!is_one_address || what.orders) return run_reads(line, what, target);
  ReadReport report;
  const CommandResult result = read_one(line, what.names.front(), target, report);
  print_address(result, what);
  if (const std::string hint = hint_of(report); !hint.empty())
    std::cerr << "hint: " << hint << '\n';
  return exit_status(result);
}

/// Returns the fault in the call; empty if there is none.
std::string call_fault(const OneShot& what, const DeviceConfig& device) {
  if (what.op == Op::read && what.names.empty() && device.tags.empty())
    return what.device + " has no tags: name an address";
  if (!what.type && what.count == 0) return {};
  const std::string option = what.type ? "--type" : "--count";
  const auto tag = std::ranges::find_if(
      what.names, [&](const std::string& name) { return tag_named(name, device) != nullptr; });
  if (tag != what.names.end())
    return option + ": " + *tag + " is a tag, and the config sets its type and count";
  return what.names.empty() ? option + " needs an address" : std::string();
}

/// Executes a write or a force, recorded in the audit if the config has a store.
CommandResult command_result(const Config& config, const OneShot& what, CommandTarget target) {
  const std::string& name = what.names.front();
  if (config.store.path.empty()) {
    std::cerr << "not recorded: store.path is not set, so there is no audit\n";
    return DirectLine(config, what.trace).carry_out(what.op, name, std::move(target));
  }
  CommandLineAudit audit(config.store, utc_now_ms(), what.device, text_of(what));
  if (!audit.fault().empty())
    return not_in_the_audit(command_for(what.op, name, config.devices.front(), std::move(target)),
                            audit.fault());
  return DirectLine(config, what.trace).carry_out(what.op, name, std::move(target), &audit);
}

}  // namespace

int run_one_shot(const std::string& path, const OneShot& what) {
  log::set_level(log::Level::error);
  std::signal(SIGPIPE, SIG_IGN);
  auto loaded = loaded_for_lines(path);
  if (!loaded) return kWrong;
  note_running_agent(path);
  Config& config = *loaded;
  if (!narrow(config, what.device))
    return refused("", "no device " + what.device + " in the config" +
                           in_place_of(what.device, names_in(config.devices)));
  if (const std::string fault = call_fault(what, config.devices.front()); !fault.empty())
    return refused("", fault);
  CommandTarget target;
  target.count = what.count;
  if (what.value) target.value = value_of_text(*what.value);
  if (what.type) {
    const auto type = data_type_from(*what.type);
    if (!type) return refused("--type", type.error().text);
    target.type = *type;
  }
  if (what.word_order) {
    const auto order = byte_order_from(*what.word_order);
    if (!order) return refused("--word-order", order.error().text);
    target.order = *order;
  }
  if (what.op == Op::read) {
    DirectLine line(config, what.trace);
    return run_read(line, what, target);
  }
  const auto asked = target.value;
  const CommandResult result = command_result(config, what, std::move(target));
  print_command(result, what);
  warn_of_rounding(result, asked);
  return exit_status(result);
}

}  // namespace fxagent
