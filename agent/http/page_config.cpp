#include "agent/http/page_config.h"

#include <chrono>
#include <vector>

#include "agent/line_time.h"
#include "agent/text/json_writer.h"
#include "protocol/options.h"
#include "protocol/plan/plan.h"

namespace fxagent {
namespace {

using json::Writer;

std::string model_of(const DeviceConfig& device) {
  if (device.options == nullptr) return {};
  const auto* model = option<std::string>(*device.options, "model");
  return model == nullptr ? std::string() : *model;
}

/// Writes a tag as an array, since there may be many: name, address, type, unit, 1 if a command may
/// write it, description.
void write_tag(Writer& out, const TagConfig& tag) {
  out.begin_array();
  out.string(tag.name).string(tag.point.address.text);
  std::string type(to_string(tag.point.type));
  if (tag.point.is_array) type += "[" + std::to_string(tag.point.count) + "]";
  out.string(type).string(tag.units->unit).integer(std::int64_t{tag.writable ? 1 : 0});
  out.string(tag.units->description);
  out.end_array();
}

void write_device(Writer& out, const DeviceConfig& device) {
  out.begin_object();
  out.key("name").string(device.name).key("link").integer(std::int64_t{device.link});
  out.key("protocol").string(device.protocol->name).key("model").string(model_of(device));
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

}  // namespace

std::string page_config(const AgentStatus& status) {
  const Config& config = *status.config;
  Writer out;
  out.begin_object();
  out.key("hash").string(config.hash).key("boot").string(status.boot);
  out.key("version").string(status.version).key("agent").string(config.id);
  out.key("base").string(config.base_topic());
  out.key("servers").begin_array();
  for (const std::string& server : config.mqtt.servers) out.string(server);
  out.end_array();
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
  out.key("warnings").begin_array();
  for (const std::string& warning : config.warnings) out.string(warning);
  out.end_array().end_object();
  return out.take();
}

std::string page_plan(const Config& config, std::size_t link) {
  const LinkConfig& line = config.links.at(link);
  const bool is_known = line.char_time.count() > 0;
  Writer out;
  out.begin_object().key("hash").string(config.hash).key("groups").begin_array();
  for (std::size_t d = 0; d < config.devices.size(); ++d) {
    const DeviceConfig& device = config.devices[d];
    if (device.is_vacant() || device.link != link || device.codec == nullptr) continue;
    for (std::size_t g = 0; g < device.groups.size(); ++g) {
      std::vector<Point> points;
      for (const TagConfig& tag : device.tags)
        if (tag.group == g) points.push_back(tag.point);
      if (points.empty()) continue;
      const Plan plan =
          make_plan(*device.codec, points, cost_of(device, line.char_time, device.turnaround),
                    device.max_block_bytes);
      out.begin_object().key("d").integer(std::uint64_t{d}).key("g").integer(std::uint64_t{g});
      out.key("exchanges").integer(std::uint64_t{plan.exchange_count()}).key("ms");
      is_known ? out.milliseconds(poll_time(*device.codec, plan, timing_of(device, line.char_time)))
               : out.null();
      out.end_object();
    }
  }
  out.end_array().end_object();
  return out.take();
}

}  // namespace fxagent
