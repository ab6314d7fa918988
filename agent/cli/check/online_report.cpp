#include "agent/cli/check/online_report.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <map>
#include <nlohmann/json.hpp>
#include <string_view>
#include <utility>

#include "agent/cli/exit_status.h"
#include "agent/cli/report/read_report.h"
#include "agent/text/json.h"
#include "agent/text/text.h"
#include "protocol/value/pack.h"

namespace fxagent {
namespace {

using Json = nlohmann::ordered_json;
using DeviceState = OnlineDevice::State;
using LinkState = OnlineLink::State;

// Limits of the text output; the JSON output is complete.
constexpr std::size_t kMostToDo = 20;
constexpr std::size_t kMostTags = 8;

/// Escapes text from devices and brokers for the terminal.
std::string shown_text(std::string_view text) { return escaped(text, Escape::message); }

bool is_silence(const OnlineDevice::BadTag& bad) {
  return bad.reason == BadReason::timeout || bad.reason == BadReason::link_down;
}

bool is_silent(const OnlineDevice& device) {
  return device.state == DeviceState::silent ||
         (device.state == DeviceState::answers && std::ranges::any_of(device.bad, is_silence));
}

bool differs(const OnlineDevice& device) {
  return device.state == DeviceState::answers &&
         (!device.reason.empty() || !device.bad.empty() || !device.model_configured.empty());
}

bool is_faulty(const OnlineBroker& broker) {
  return !broker.text.empty() || !broker.refused.empty();
}

std::string_view word(LinkState state) {
  constexpr std::array kWords{"open", "down", "held", "unused"};  // the order of LinkState
  static_assert(kWords.size() == static_cast<std::size_t>(LinkState::unused) + 1);
  return kWords[static_cast<std::size_t>(state)];
}

std::string_view word(DeviceState state) {
  constexpr std::array kWords{"answers", "silent", "not_asked", "broadcast"};
  static_assert(kWords.size() == static_cast<std::size_t>(DeviceState::broadcast) + 1);
  return kWords[static_cast<std::size_t>(state)];
}

std::string_view word(OnlineHolder::Runs runs) {
  constexpr std::array kWords{"the agent of this config", "an agent of another config",
                              "another program"};
  static_assert(kWords.size() == static_cast<std::size_t>(OnlineHolder::Runs::no_agent) + 1);
  return kWords[static_cast<std::size_t>(runs)];
}

// ---- lines --------------------------------------------------------------------------------------

std::string said(const OnlineLink& link) {
  switch (link.state) {
    case LinkState::open:
      return "open";
    case LinkState::down:
      return "does not open";
    case LinkState::held:
      return "not checked: " + link.holder->program + ", pid " + std::to_string(link.holder->pid) +
             ", uses it (" + std::string(word(link.holder->runs)) + ")";
    default:
      return "not opened: it has no devices";
  }
}

std::string said(const OnlineDevice& device, const DeviceConfig& config) {
  switch (device.state) {
    case DeviceState::silent:
      return "does not answer (" + device.reason + ")";
    case DeviceState::not_asked:
      return "not asked";
    case DeviceState::broadcast:
      return "broadcast: no unit answers";
    default:
      break;
  }
  std::string text = "answers";
  if (!device.model.empty()) text += ", " + device.model;
  if (!device.model_configured.empty())
    text += " instead of the config's " + device.model_configured;
  if (device.run) text += *device.run ? ", RUN" : ", STOP";
  const std::size_t tags = config.tags.size();
  if (device.bad.empty())
    text += ", " + counted(tags, "tag") + " read";
  else
    text += ", " + std::to_string(device.good) + " of " + counted(tags, "tag") + " read";
  return text;
}

std::string said(const OnlineBroker& broker) {
  if (!broker.connected) return "does not answer";
  return is_faulty(broker) ? "answers, but refuses what the agent needs" : "answers";
}

/// Returns what the check cannot know of a broker that answers.
std::string untested(const OnlineBroker& broker) {
  return std::string("the right to publish") +
         (broker.is_publishing_tried ? " anything but responses" : "") +
         (broker.sends_commands ? "; the right to receive commands, which mosquitto does not report"
                                : "");
}

// ---- requests to a running agent ----------------------------------------------------------------

/// Returns a command line that has the agent read the first tag of the device; without tags, one
/// that shows its state.
std::string offer(const Config& config, const DeviceConfig& device, const std::string& id) {
  const std::string& server = config.mqtt.servers.front();
  const std::size_t begin = server.find("://") + 3;
  const std::size_t colon = server.rfind(':');
  std::string host = server.substr(begin, colon - begin);
  if (host.starts_with('[')) host = host.substr(1, host.size() - 2);
  const std::string base = config.base_topic() + "/" + device.name;
  std::string reach = " -h " + host + " -p " + server.substr(colon + 1);
  if (server.starts_with("mqtts://"))
    reach += config.mqtt.tls && !config.mqtt.tls->ca_file.empty()
                 ? " --cafile " + config.mqtt.tls->ca_file
                 : " --tls-use-os-certs";
  if (device.tags.empty()) return "mosquitto_sub" + reach + " -C 1 -t " + base + "/state";
  Json command;
  command["id"] = id;
  command["op"] = "read";
  command["tag"] = std::string(device.tags.front().name);
  return "mosquitto_rr" + reach + " -W 10 -q 1 -t " + base + "/command -e " + base +
         "/result/check -m '" + dumped(command) + "'";
}

// ---- recommended actions ------------------------------------------------------------------------

/// Returns the names of at most kMostTags tags, and the number of the rest.
std::string names_of(const DeviceConfig& config, const std::vector<std::uint32_t>& tags) {
  std::string text;
  for (const std::uint32_t tag : tags) {
    if (&tag - tags.data() == kMostTags)
      return text + " and " + std::to_string(tags.size() - kMostTags) + " more";
    const TagConfig& named = config.tags[tag];
    text += (text.empty() ? "" : ", ") + std::string(named.name) + " (" +
            std::string(named.point.address.text) + ")";
  }
  return text;
}

std::string cure_of(BadReason reason) {
  switch (reason) {
    case BadReason::nak:
      return "the device refuses to read it: is the address right, and does this model have it?";
    case BadReason::unsupported:
      return "this protocol cannot read it from this model, or the place has another name on this "
             "PLC: is the model right?";
    case BadReason::bad_value:
      return "the bytes are not a value of its type: are the address and the type right?";
    case BadReason::bad_frame:
      return "damaged answers: check the cable, its ends and its shield, and look for another "
             "master on this line";
    default:
      return "no answer to this read, although the device answers others";
  }
}

void add_link(std::vector<std::string>& to_do, const Config& config, const OnlineFindings& findings,
              std::size_t index) {
  const OnlineLink& link = findings.links[index];
  if (link.state == LinkState::down) to_do.push_back(link.name + ": " + link.text);
  if (link.state != LinkState::held) return;
  const std::string end = link.holder->program + " (pid " + std::to_string(link.holder->pid) + ")";
  if (!link.holder->request.empty())
    to_do.push_back(link.name + ": " + link.holder->request);
  else if (std::holds_alternative<SerialSettings>(config.links[index].channel))
    to_do.push_back(link.name + ": end " + end + ", or give the agent a port of its own");
  else
    to_do.push_back(link.name + ": end " + end +
                    " for this check: a second connection may close the first");
}

void add_device(std::vector<std::string>& to_do, const Config& config,
                const OnlineFindings& findings, std::size_t index) {
  const OnlineDevice& device = findings.devices[index];
  const DeviceConfig& configured = config.devices[index];
  const auto add = [&](const std::string& text) { to_do.push_back(configured.name + ": " + text); };
  const bool is_link_down = findings.links[configured.link].state == LinkState::down;
  if (device.state == DeviceState::silent && !is_link_down) add(device.text_or_reason());
  if (device.state != DeviceState::answers) return;
  if (!device.model_configured.empty())
    add("the PLC is an " + device.model + ", but the config says " + device.model_configured +
        ": set \"model\": \"" + device.model + "\", or check that this is the right PLC");
  if (device.bad.empty() && !device.reason.empty()) add(device.text_or_reason());
  std::map<BadReason, std::vector<std::uint32_t>> bad;
  for (const OnlineDevice::BadTag& each : device.bad) bad[each.reason].push_back(each.tag);
  for (const auto& [reason, tags] : bad) add(names_of(configured, tags) + ": " + cure_of(reason));
  for (const OnlineDevice::Hint& hint : device.hints)
    add(names_of(configured, {hint.tag}) + ": " + hint.text);
  if (device.run == false) add("the PLC is in STOP: its program does not run");
}

std::vector<std::string> to_do_of(const Config& config, const OnlineFindings& findings) {
  std::vector<std::string> to_do;
  for (std::size_t i = 0; i < findings.links.size(); ++i) add_link(to_do, config, findings, i);
  for (std::size_t i = 0; i < findings.devices.size(); ++i) add_device(to_do, config, findings, i);
  for (const OnlineBroker& broker : findings.brokers) {
    if (!broker.text.empty()) to_do.push_back(broker.server + ": " + broker.text);
    for (const std::string& right : broker.refused)
      to_do.push_back(broker.server + ": it does not let the agent's user " + right +
                      "; fxagent acl prints access rules for mosquitto");
  }
  return to_do;
}

Json json_of(const OnlineLink& link) {
  Json out;
  out["link"] = link.name;
  out["place"] = link.place;
  out["state"] = std::string(word(link.state));
  out["text"] = or_null(link.text);
  out["holder"] = Json();
  if (link.holder)
    out["holder"] = {{"program", link.holder->program},
                     {"pid", link.holder->pid},
                     {"is", std::string(word(link.holder->runs))}};
  return out;
}

Json json_of(const OnlineDevice& device, const DeviceConfig& config, const std::string& link) {
  Json out;
  out["device"] = config.name;
  out["link"] = link;
  out["state"] = std::string(word(device.state));
  out["reason"] = or_null(device.reason);
  out["text"] = or_null(device.text);
  out["model"] = or_null(device.model);
  out["model_configured"] = or_null(device.model_configured);
  out["run"] = or_null(device.run);
  out["tags"] = config.tags.size();
  out["good"] = device.good;
  auto& bad = out["bad"] = Json::array();
  for (const OnlineDevice::BadTag& each : device.bad) {
    const TagConfig& tag = config.tags[each.tag];
    bad.push_back({{"tag", std::string(tag.name)},
                   {"address", std::string(tag.point.address.text)},
                   {"reason", std::string(to_string(each.reason))}});
  }
  auto& hints = out["hints"] = Json::array();
  for (const OnlineDevice::Hint& each : device.hints)
    hints.push_back({{"tag", std::string(config.tags[each.tag].name)}, {"text", each.text}});
  return out;
}

/// Returns a hint if the value is a float whose word order is probably wrong; else empty.
std::string hint_of(const Point& point, const Value& value, const ProtocolInfo& protocol) {
  if (point.type != DataType::float32 && point.type != DataType::float64) return {};
  const auto image = pack(point, value);
  if (!image) return {};
  return word_order_hint(point, word_orders(protocol),
                         read_from(*image, point.address.span.first_bit));
}

}  // namespace

std::string request_to(const Config& config, std::size_t link, const std::string& id) {
  const auto device = std::ranges::find(config.devices, link, &DeviceConfig::link);
  if (device == config.devices.end()) return {};
  const std::string user = config.mqtt.username.empty()
                               ? std::string()
                               : ", with -u and -P of a user who may send commands";
  return "have the running agent read" + user + ": " + offer(config, *device, id);
}

// ---- answers of the devices ---------------------------------------------------------------------

OnlineDevices::OnlineDevices(const Config& config)
    : config_(&config), found_(config.devices.size()), awaited_(config.devices.size()) {}

void OnlineDevices::ask(std::uint32_t device) {
  found_[device] = {};
  Awaited& awaited = awaited_[device];
  awaited.status = true;
  const DeviceConfig& config = config_->devices[device];
  if (config.codec->is_broadcast()) return;
  for (const TagConfig& tag : config.tags) awaited.samples.insert(tag.group);
}

void OnlineDevices::take(const DeviceStatus& status) {
  if (status.reason == "starting") return;
  OnlineDevice& found = found_[status.device];
  awaited_[status.device].status = false;
  found.reason = status.reason;
  found.text = status.reason_text;
  found.model = status.model;
  found.model_configured = status.model_configured;
  found.run = status.run;
  if (status.state == DeviceStatus::State::offline)
    found.state = DeviceState::silent;
  else if (config_->devices[status.device].codec->is_broadcast())
    found.state = DeviceState::broadcast;
  else
    found.state = DeviceState::answers;
}

void OnlineDevices::take(const Telemetry& sample) {
  if (awaited_[sample.device].samples.erase(sample.group) == 0) return;  // one sample is enough
  OnlineDevice& found = found_[sample.device];
  for (const TagReading& reading : sample.readings) {
    if (reading.bad) {
      found.bad.push_back({reading.tag, *reading.bad});
      continue;
    }
    ++found.good;
    const DeviceConfig& device = config_->devices[sample.device];
    const Point& point = device.tags[reading.tag].point;
    if (std::string hint = hint_of(point, reading.value, *device.protocol); !hint.empty())
      found.hints.push_back({reading.tag, std::move(hint)});
  }
}

bool OnlineDevices::settled() const {
  for (std::size_t i = 0; i < found_.size(); ++i) {
    if (awaited_[i].status) return false;
    if (found_[i].state == DeviceState::answers && !awaited_[i].samples.empty()) return false;
  }
  return true;
}

std::vector<std::uint32_t> OnlineDevices::worth_another_try() const {
  const std::string_view timeout = to_string(BadReason::timeout);
  std::vector<std::uint32_t> devices;
  for (std::uint32_t i = 0; i < found_.size(); ++i) {
    const bool may_pass = std::ranges::any_of(found_[i].bad, [](const OnlineDevice::BadTag& bad) {
      return bad.reason == BadReason::timeout || bad.reason == BadReason::bad_frame;
    });
    const bool is_silent = found_[i].state == DeviceState::silent && found_[i].reason == timeout;
    if (is_silent || (found_[i].state == DeviceState::answers && may_pass)) devices.push_back(i);
  }
  return devices;
}

// ---- report -------------------------------------------------------------------------------------

void judge_links(const Config& config, OnlineFindings& findings) {
  const std::string_view link_down = to_string(BadReason::link_down);
  for (std::size_t i = 0; i < findings.devices.size(); ++i) {
    const OnlineDevice& device = findings.devices[i];
    OnlineLink& link = findings.links[config.devices[i].link];
    if (link.state == LinkState::held || device.state == DeviceState::not_asked) continue;
    if (device.reason != link_down) {
      link.state = LinkState::open;
      link.text.clear();
    } else if (link.state == LinkState::unused) {
      link.state = LinkState::down;
      link.text = device.text_or_reason();
    }
  }
}

int exit_status(const OnlineFindings& findings) {
  const auto link_is = [&](LinkState state) {
    return std::ranges::find(findings.links, state, &OnlineLink::state) != findings.links.end();
  };
  if (link_is(LinkState::down) || std::ranges::any_of(findings.devices, is_silent) ||
      !std::ranges::all_of(findings.brokers, &OnlineBroker::connected))
    return kFailed;
  if (link_is(LinkState::held)) return kHeld;
  if (std::ranges::any_of(findings.devices, differs) ||
      std::ranges::any_of(findings.brokers, is_faulty))
    return kDiffers;
  return kDone;
}

std::string online_text(const Config& config, const OnlineFindings& findings) {
  std::string out;
  const auto line = [&out](const std::string& text) { out += shown_text(text) + "\n"; };
  for (const OnlineLink& link : findings.links)
    line("link " + link.name + ", " + link.place + ": " + said(link));
  for (std::size_t i = 0; i < findings.devices.size(); ++i) {
    const DeviceConfig& device = config.devices[i];
    line("device " + device.name + " on " + config.links[device.link].name + ": " +
         said(findings.devices[i], device));
  }
  for (const OnlineBroker& broker : findings.brokers) {
    line("broker " + broker.server + ": " + said(broker));
    if (broker.connected) line("  not tested: " + untested(broker));
  }
  const auto to_do = to_do_of(config, findings);
  if (to_do.empty()) {
    line("Everything answers. Next: fxagent run " + findings.path);
    return out;
  }
  line("What to do:");
  for (const std::string& each : to_do) {
    if (static_cast<std::size_t>(&each - to_do.data()) == kMostToDo) {
      line("  and " + std::to_string(to_do.size() - kMostToDo) + " more, which --json shows");
      break;
    }
    line("  " + each);
  }
  return out;
}

std::string online_json(const Config& config, const OnlineFindings& findings) {
  Json out;
  const int status = exit_status(findings);
  out["ok"] = status == kDone;
  out["status"] = status;
  auto& links = out["links"] = Json::array();
  for (const OnlineLink& link : findings.links) links.push_back(json_of(link));
  auto& devices = out["devices"] = Json::array();
  for (std::size_t i = 0; i < findings.devices.size(); ++i)
    devices.push_back(
        json_of(findings.devices[i], config.devices[i], config.links[config.devices[i].link].name));
  auto& brokers = out["brokers"] = Json::array();
  for (const OnlineBroker& broker : findings.brokers)
    brokers.push_back({{"server", broker.server},
                       {"connected", broker.connected},
                       {"text", or_null(broker.text)},
                       {"refused", broker.refused},
                       {"publishing_tried", broker.is_publishing_tried}});
  out["to_do"] = to_do_of(config, findings);
  return dumped(out) + "\n";
}

}  // namespace fxagent
