#include "agent/http/page_api.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <optional>
#include <span>
#include <string_view>
#include <utility>

#include "agent/config/model.h"
#include "agent/http/page_verdict.h"
#include "agent/line_time.h"
#include "agent/log/recent_events.h"
#include "agent/recorder/recording.h"
#include "agent/text/json_writer.h"
#include "agent/text/text.h"
#include "protocol/options.h"

namespace fxagent {
namespace {

using json::Writer;
using namespace std::literals;

constexpr std::size_t kMostProblems = 50;
constexpr std::size_t kMostFrames = 200;  // in one answer: the newest

template <class T>
const T* at(const std::vector<T>& list, std::size_t index) {
  return index < list.size() ? &list[index] : nullptr;
}

std::string_view word_of(log::Level level) {
  return level == log::Level::info ? "info" : level == log::Level::warn ? "warn" : "error";
}

void write_texts(Writer& out, std::string_view key, std::span<const std::string> texts) {
  out.key(key).begin_array();
  for (const std::string& text : texts) out.string(text);
  out.end_array();
}

void write_verdict(Writer& out, const Verdict& verdict) {
  out.key("problems").begin_array();
  for (std::size_t i = 0; i < std::min(verdict.problems.size(), kMostProblems); ++i) {
    const Problem& problem = verdict.problems[i];
    out.begin_object().key("severity").string(problem.severity == Severity::bad ? "bad" : "warn");
    out.key("place").string(problem.place).key("text").string(problem.text);
    out.key("cure").string(problem.cure).key("since").integer(problem.since_ms).end_object();
  }
  out.end_array();
  out.key("problems_in_all").integer(std::uint64_t{verdict.problems.size()});
  out.key("works").string(verdict.works);
}

void write_agent(Writer& out, const AgentStatus& status) {
  const BrokerStatus& broker = status.broker;
  out.key("broker").begin_object().key("server").string(broker.server);
  out.key("connected").boolean(broker.connected).key("since").integer(broker.since_ms);
  out.end_object();
  const SampleCounts& samples = status.samples;
  out.key("samples").begin_object().key("collected").integer(samples.collected);
  out.key("acknowledged").integer(samples.acknowledged).key("dropped").integer(samples.dropped);
  out.key("waiting").integer(samples.waiting()).end_object();
  out.key("store").begin_object().key("state").string(status.store_state);
  out.key("bytes").integer(status.store_bytes).key("hours_left");
  out.number(status.hours_left).end_object();
  out.key("commands").begin_object();
  for (const auto& [outcome, count] : status.commands) out.key(to_string(outcome)).integer(count);
  out.end_object();
  const ConfigStatus& config = status.config_status;
  out.key("config").begin_object().key("since").integer(config.since_ms);
  out.key("change").string(config.change).key("reload");
  if (const auto& reload = config.last_reload) {
    out.begin_object().key("state").string(reload->state).key("ts").integer(reload->ts_ms);
    write_texts(out, "errors", reload->errors);
    out.end_object();
  } else {
    out.null();
  }
  out.key("remote");
  if (const auto& remote = config.remote) {
    out.begin_object().key("version").string(remote->version);
    out.key("state").string(remote->state).end_object();
  } else {
    out.null();
  }
  out.end_object();
}

void write_commands(Writer& out, const AgentStatus& status, std::uint64_t after) {
  out.key("last_commands").begin_array();
  for (const auto& last : status.last_commands) {
    const LastCommand& command = *last;
    if (command.number <= after) continue;
    out.begin_object().key("n").integer(command.number);
    out.key("device").string(command.device).key("id").string(command.id);
    out.key("op").string(command.op).key("status").string(to_string(command.status));
    out.key("reason").string(to_string(command.reason)).key("ts").integer(command.ts_ms);
    out.key("by").string(command.by).key("target").string(command.target);
    out.key("targets").integer(std::uint64_t{command.targets}).key("value");
    write_value(out, command.value);
    out.key("detail").string(command.detail).key("took_ms").milliseconds(command.took);
    out.key("bound_ms").milliseconds(command.bound).key("frames").begin_array();
    for (const WireFrame& frame : command.frames.frames())
      out.begin_array()
          .string(frame.way == WireFrame::Way::out ? "out" : "in")
          .string(to_hex(frame.bytes))
          .end_array();
    out.end_array().end_object();
  }
  out.end_array();
}

void write_links(Writer& out, const AgentStatus& status) {
  out.key("links").begin_array();
  for (std::size_t l = 0; l < status.config->links.size(); ++l) {
    const LinkHealth* link = at(status.field->links, l);
    if (link == nullptr || status.config->links[l].is_vacant()) {
      out.null();
      continue;
    }
    // An array, since there may be many: open, doubted, percent busy, percent of load, yielded.
    out.begin_array().integer(std::int64_t{link->open ? 1 : 0});
    out.integer(std::int64_t{link->doubted ? 1 : 0});
    out.integer(static_cast<std::int64_t>(link->busy_percent));
    out.integer(static_cast<std::int64_t>(link->load_percent));
    out.integer(std::int64_t{link->yielded ? 1 : 0}).end_array();
  }
  out.end_array();
}

/// Returns the members of /api/changes that do not depend on the request, with a comma behind each.
std::string overview_of(const AgentStatus& status, std::int64_t dropped_ms) {
  Writer out;
  out.begin_object();
  write_verdict(out, verdict_of(status, dropped_ms));
  write_agent(out, status);
  write_links(out, status);
  out.end_object();
  const std::string whole = out.take();
  return whole.substr(1, whole.size() - 2) + ",";
}

void write_device(Writer& out, const DeviceStatus& device) {
  out.begin_object().key("state").string(to_string(device.state));
  out.key("reason").string(device.reason).key("cure").string(device.reason_text);
  out.key("since").integer(device.since_ms).key("model").string(device.model).key("run");
  out.boolean(device.run).end_object();
}

/// Writes the values of a group in the order of its tags: value, time, reason if bad, since when.
void write_values(Writer& out, const DeviceConfig& device, std::size_t group,
                  const GroupValues& values) {
  const auto by_tag = values.by_tag();
  out.begin_array();
  for (const TagConfig& tag : device.tags) {
    if (tag.group != group) continue;
    const auto found = by_tag.find(std::string_view(tag.name));
    if (found == by_tag.end()) {
      out.null();
      continue;
    }
    const LastValue& last = found->second;
    const bool is_single = last.type == DataType::float32 && !last.scaled;
    out.begin_array();
    write_value(out, last.value, is_single ? json::Precision::single : json::Precision::full);
    out.integer(last.ts_ms);
    if (last.bad) out.string(to_string(*last.bad)).integer(last.bad_since_ms);
    out.end_array();
  }
  out.end_array();
}

void write_link(Writer& out, const AgentStatus& status, std::size_t link) {
  const LinkHealth* health = at(status.field->links, link);
  if (health == nullptr) return;
  out.key("link").begin_object().key("l").integer(std::uint64_t{link});
  out.key("exchanges").integer(health->exchanges).key("timeouts").integer(health->timeouts);
  out.key("naks").integer(health->naks).key("bad_frames").integer(health->bad_frames);
  out.key("unexpected_bytes").integer(health->unexpected_bytes);
  out.key("doubts").integer(health->doubts);
  out.key("last_error").string(health->last_error);
  out.key("last_error_ts").integer(health->last_error_ms);
  out.key("p50").number(health->turnaround_ms.p50).key("p99").number(health->turnaround_ms.p99);
  out.key("devices").begin_array();
  for (std::size_t d = 0; d < status.config->devices.size(); ++d) {
    const DeviceConfig& device = status.config->devices[d];
    const DeviceHealth* counts = at(status.field->devices, d);
    if (device.is_vacant() || device.link != link || counts == nullptr) continue;
    out.begin_object().key("d").integer(std::uint64_t{d}).key("polls").integer(counts->polls);
    out.key("missed").integer(counts->missed).key("late_p50").number(counts->late_ms.p50);
    out.key("late_p99").number(counts->late_ms.p99).key("dropped");
    const std::uint64_t* dropped = at(status.dropped, d);
    out.integer(dropped == nullptr ? 0 : *dropped).key("reached_ms").begin_array();
    for (const std::chrono::milliseconds reached : counts->reached)
      out.integer(std::int64_t{reached.count()});
    out.end_array().end_object();
  }
  out.end_array().end_object();
}

void write_events(Writer& out, std::uint64_t after) {
  out.key("events").begin_array();
  for (const log::Event& event : log::events_after(after, PageApi::kMostEvents)) {
    out.begin_object().key("n").integer(event.number).key("ts").integer(event.ts_ms);
    out.key("level").string(word_of(event.level)).key("event").string(event.name);
    out.key("text").string(event.text).key("count").integer(event.count).end_object();
  }
  out.end_array();
}

/// Writes a tag as an array, since there may be many: name, address, type, unit, 1 if a command may
/// write it, description, 1 if it has a scale or an offset, labels of its values.
void write_tag(Writer& out, const TagConfig& tag) {
  out.begin_array();
  out.string(tag.name).string(tag.point.address.text);
  std::string type(to_string(tag.point.type));
  if (tag.point.is_array) type += "[" + std::to_string(tag.point.count) + "]";
  out.string(type).string(tag.units->unit).integer(std::int64_t{tag.writable ? 1 : 0});
  out.string(tag.units->description).integer(std::int64_t{tag.point.scaled() ? 1 : 0});
  out.begin_object();
  for (const auto& [number, label] : tag.units->states)
    out.key(std::to_string(number)).string(label);
  out.end_object().end_array();
}

void write_device(Writer& out, const DeviceConfig& device) {
  out.begin_object();
  out.key("name").string(device.name).key("link").integer(std::int64_t{device.link});
  const auto* model =
      device.options == nullptr ? nullptr : option<std::string>(*device.options, "model");
  out.key("protocol").string(device.protocol->name);
  out.key("model").string(model == nullptr ? std::string_view() : *model);
  out.key("timeout_ms").integer(std::int64_t{device.timeout.count()});
  out.key("groups").begin_array();
  for (std::size_t g = 0; g < device.groups.size(); ++g) {
    const GroupConfig& group = device.groups[g];
    out.begin_object().key("name").string(group.name);
    out.key("interval_ms").integer(std::int64_t{group.interval.count()});
    out.key("on_change").boolean(group.on_change);
    out.key("tags").begin_array();
    for (const TagConfig& tag : device.tags)
      if (tag.group == g) write_tag(out, tag);
    out.end_array().end_object();
  }
  out.end_array();
  out.key("allow").begin_array();
  for (const Span& span : device.commands.allow) {
    const AddressSpace& addresses = device.codec->addresses();
    const std::string first = addresses.name_of({span.space, span.first_bit, 1});
    const std::string last = addresses.name_of({span.space, span.end_bit() - 1, 1});
    out.string(first == last ? first : std::string(first).append("-").append(last));
  }
  out.end_array().end_object();
}

/// Returns /api/config: all that stays the same until the next reload, without secrets and with
/// templates expanded. Links and devices stand at their index in the config; a vacant place is
/// null.
std::string page_config(const AgentStatus& status) {
  const Config& config = *status.config;
  Writer out;
  out.begin_object();
  out.key("hash").string(config.hash).key("boot").string(status.boot);
  out.key("version").string(status.version).key("agent").string(config.id);
  out.key("base").string(config.base_topic());
  write_texts(out, "servers", config.mqtt.servers);
  out.key("store").word(config.store.path);
  out.key("commands").boolean(config.http && !config.http->token_file.empty());
  out.key("frames").boolean(config.recorder.has_value());
  out.key("links").begin_array();
  for (const LinkConfig& link : config.links) {
    if (link.is_vacant()) {
      out.null();
      continue;
    }
    out.begin_object().key("name").string(link.name).key("wire").string(channel_text(link));
    out.key("yields").boolean(link.allow_yield);
    out.end_object();
  }
  out.end_array().key("devices").begin_array();
  for (const DeviceConfig& device : config.devices)
    device.is_vacant() ? void(out.null()) : write_device(out, device);
  out.end_array();
  write_texts(out, "warnings", config.warnings);
  out.end_object();
  return out.take();
}

/// Returns /api/plan: for each group on the link its line time per cycle and the number of
/// exchanges, as planned from the config. The time is null if the speed of the line is unknown.
std::string page_plan(const Config& config, std::size_t link) {
  const LinkConfig& line = config.links.at(link);
  const bool is_known = line.char_time.count() > 0;
  Writer out;
  out.begin_object().key("hash").string(config.hash).key("groups").begin_array();
  for (std::size_t d = 0; d < config.devices.size(); ++d) {
    const DeviceConfig& device = config.devices[d];
    if (device.is_vacant() || device.link != link || device.codec == nullptr) continue;
    const LineTiming timing = timing_of(device, line.char_time);
    for (const auto& [g, tags, points, plan] : group_plans(*device.codec, device, line.char_time)) {
      out.begin_object().key("d").integer(std::uint64_t{d}).key("g").integer(std::uint64_t{g});
      out.key("exchanges").integer(std::uint64_t{plan.exchange_count()}).key("ms");
      is_known ? out.milliseconds(poll_time(*device.codec, plan, timing)) : out.null();
      out.end_object();
    }
  }
  out.end_array().end_object();
  return out.take();
}

/// Returns the frames numbered `since` or higher as JSON, each explained field by field.
std::string page_frames(const FrameRing& ring, std::uint64_t since) {
  RecordedFrames newest = ring.frames(since, kMostFrames);
  const Replay replay({{}, std::move(newest.devices), std::move(newest.frames)});
  Writer out;
  out.begin_object().key("next").integer(newest.next).key("frames").begin_array();
  for (const RecordedFrame& frame : replay.recording().frames) {
    const auto explanation = replay.explain(frame);
    out.begin_object().key("at_us").integer(frame.at_us).key("way").string(to_string(frame.way));
    out.key("device").string(replay.device_of(frame)).key("after_ms").milliseconds(frame.after);
    out.key("hex").string(to_hex(frame.bytes)).key("says").string(meaning_of(frame, explanation));
    out.key("fields").begin_array();
    if (explanation)
      for (const auto& [name, value] : explanation->fields)
        out.begin_array().string(name).string(value).end_array();
    out.end_array().end_object();
  }
  out.end_array().end_object();
  return out.take();
}

}  // namespace

/// The arguments of /api/changes.
struct PageApi::Asked {
  std::uint64_t since = 0;  ///< the last snapshot that the page has
  /// The snapshot of its values. Below `since` if it now asks for other groups than before.
  std::uint64_t values = 0;
  std::uint64_t events = 0;    ///< the last event that it has
  std::uint64_t commands = 0;  ///< the last command that it has
  std::optional<std::size_t> link;
  std::vector<std::pair<std::size_t, std::size_t>> groups;  ///< device and group

  /// Returns nullopt if an argument is wrong.
  static std::optional<Asked> from(const HttpRequest& request) {
    Asked asked;
    bool is_good = true;
    const auto number = [&](std::string_view name) -> std::optional<std::uint64_t> {
      const auto given = request.arguments.find(name);
      if (given == request.arguments.end()) return std::nullopt;
      const auto value = number_from<std::uint64_t>(given->second);
      is_good = is_good && value.has_value();
      return value;
    };
    asked.since = number("since").value_or(0);
    asked.values = number("values").value_or(0);
    asked.events = number("events").value_or(0);
    asked.commands = number("commands").value_or(0);
    asked.link = number("link");
    if (!is_good) return std::nullopt;
    const auto given = request.arguments.find("groups");
    std::string_view rest = given == request.arguments.end() ? std::string_view() : given->second;
    while (!rest.empty()) {
      const std::string_view one = take_until(rest, ',');
      const std::size_t dot = one.find('.');
      if (dot == one.npos) return std::nullopt;
      const auto device = number_from<std::uint64_t>(one.substr(0, dot));
      const auto group = number_from<std::uint64_t>(one.substr(dot + 1));
      if (!device || !group || asked.groups.size() == kMostGroups) return std::nullopt;
      asked.groups.emplace_back(*device, *group);
    }
    return asked;
  }
};

HttpAnswer PageApi::answer(const HttpRequest& request, std::shared_ptr<const AgentStatus> status) {
  take(std::move(status));
  if (request.path == "/api/config") return config(request);
  constexpr std::array kOthers{"/api/changes"sv, "/api/plan"sv, "/api/frames"sv};
  if (std::ranges::find(kOthers, request.path) == kOthers.end())
    return refusal(kNotFound,
                   "there are /api/config, /api/plan, /api/frames, /api/changes and, for POST, "
                   "/api/command");
  const auto asked = Asked::from(request);
  if (!asked)
    return refusal(kBadRequest,
                   "since, values, events, commands and link are numbers; groups is a list as in "
                   "0.0,0.1, of at most 200");
  if (request.path == "/api/changes") return changes(*asked);
  const auto& links = status_->config->links;
  if (!asked->link || *asked->link >= links.size() || links[*asked->link].is_vacant())
    return refusal(kNotFound, "there is no such link");
  if (request.path == "/api/frames") return frames(links[*asked->link].name, asked->since);
  return json_answer(kOk, page_plan(*status_->config, *asked->link));
}

/// Takes over a newer status and notes what has changed. Parts that did not change share their
/// objects with the previous status.
void PageApi::take(std::shared_ptr<const AgentStatus> status) {
  if (status == status_) return;
  const auto before = std::exchange(status_, std::move(status));
  ++snapshot_;
  const bool is_anew = before == nullptr || before->config != status_->config;
  if (is_anew) {
    changed_ = {};
    config_text_.reset();
  }
  changed_.devices.resize(status_->config->devices.size(), snapshot_);
  changed_.groups.resize(status_->config->devices.size());
  for (std::size_t d = 0; d < changed_.devices.size(); ++d) {
    const auto* now = at(status_->devices, d);
    const auto* old = is_anew ? nullptr : at(before->devices, d);
    if (now != nullptr && (old == nullptr || *now != *old)) changed_.devices[d] = snapshot_;
    const auto* groups = at(status_->values, d);
    const auto* old_groups = is_anew ? nullptr : at(before->values, d);
    if (groups == nullptr) continue;
    changed_.groups[d].resize(groups->size(), snapshot_);
    for (std::size_t g = 0; g < groups->size(); ++g) {
      const auto* values = old_groups == nullptr ? nullptr : at(*old_groups, g);
      if (values == nullptr || *values != (*groups)[g]) changed_.groups[d][g] = snapshot_;
    }
  }
  if (status_->samples.dropped > (before == nullptr ? 0 : before->samples.dropped))
    dropped_ms_ = status_->ts_ms;
  overview_ = overview_of(*status_, dropped_ms_);
}

HttpAnswer PageApi::config(const HttpRequest& request) {
  const std::string etag = "\"" + status_->config->hash + "-" + status_->boot + "\"";
  if (request.if_none_match == etag)
    return {kNotModified, kJson, std::make_shared<const std::string>(), etag};
  if (!config_text_) config_text_ = std::make_shared<const std::string>(page_config(*status_));
  return {kOk, kJson, config_text_, etag};
}

HttpAnswer PageApi::frames(const std::string& link, std::uint64_t since) const {
  const auto ring = recorder_ == nullptr ? nullptr : recorder_->ring_of(link);
  if (!ring)
    return refusal(kNotFound,
                   "frames are not kept; a section \"recorder\" in the config keeps them");
  return json_answer(kOk, page_frames(*ring, since));
}

HttpAnswer PageApi::changes(const Asked& asked) const {
  if (asked.since == snapshot_ && (asked.values == snapshot_ || asked.groups.empty()) &&
      !asked.link && log::events_after(asked.events, 1).empty())
    return json_answer(kNotModified, "");
  const AgentStatus& status = *status_;
  // A number above ours is of another run.
  const auto known = [this](std::uint64_t number) { return number > snapshot_ ? 0 : number; };
  const std::uint64_t since = known(asked.since);
  const std::uint64_t values_since = known(asked.values);
  Writer out(overview_.size() + 4096);
  out.begin_object().key("now").integer(snapshot_).key("boot").string(status.boot);
  out.key("hash").string(status.config->hash).key("ts").integer(status.ts_ms);
  out.key("uptime_s").integer(std::int64_t{status.uptime.count()});
  out.key("devices").begin_object();
  for (std::size_t d = 0; d < changed_.devices.size(); ++d) {
    const auto* device = at(status.devices, d);
    if (changed_.devices[d] <= since || device == nullptr || *device == nullptr) continue;
    out.key(std::to_string(d));
    write_device(out, **device);
  }
  out.end_object();
  out.key("values").begin_object();
  for (const auto& [d, g] : asked.groups) {
    const auto* groups = at(status.values, d);
    const auto* values = groups == nullptr ? nullptr : at(*groups, g);
    if (values == nullptr || *values == nullptr || changed_.groups[d][g] <= values_since) continue;
    out.key(std::to_string(d) + "." + std::to_string(g));
    write_values(out, status.config->devices[d], g, **values);
  }
  out.end_object();
  if (asked.link) write_link(out, status, *asked.link);
  write_commands(out, status, asked.commands);
  write_events(out, asked.events);
  out.end_object();
  std::string text = out.take();
  text.insert(1, overview_);
  return json_answer(kOk, std::move(text));
}

}  // namespace fxagent
