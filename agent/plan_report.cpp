#include "agent/plan_report.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <nlohmann/json.hpp>
#include <utility>

#include "protocol/plan.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using Json = nlohmann::ordered_json;

// CONTRACT of the field: RUN or STOP is asked for every 10 s where the protocol can tell.
constexpr milliseconds kRunStateEvery{10000};
constexpr std::uint32_t kBlockSizes[] = {16, 32, 64, 0};

double ms(nanoseconds duration) {
  return std::round(std::chrono::duration<double, std::milli>(duration).count() * 10) / 10;
}

/// The codec that tells what may be asked: of the widest model where the real one is not known.
std::shared_ptr<const Codec> widest(const DeviceConfig& device) {
  const auto& models = device.protocol->models;
  if (!device.codec->model().empty() || models.empty()) return device.codec;
  return device.codec->with_model(models.back());
}

LineTiming timing_of(const DeviceConfig& device, nanoseconds char_time) {
  return {char_time, device.gap, device.turnaround, device.enquire == EnquirePolicy::always};
}

Plan plan_of(const Codec& codec, const DeviceConfig& device, std::span<const Point> points,
             nanoseconds char_time, std::uint32_t max_block_bytes) {
  return make_plan(codec, points, LineCost{char_time, device.turnaround + device.gap},
                   max_block_bytes);
}

std::vector<Point> points_of(const DeviceConfig& device, std::uint32_t group) {
  std::vector<Point> points;
  for (const TagConfig& tag : device.tags)
    if (tag.group == group) points.push_back(tag.point);
  return points;
}

/// Bits of a read that some point asks for.
std::uint32_t asked_bits(const PlannedRead& planned, std::span<const Point> points) {
  const Span& read = planned.read.span;
  std::vector<bool> asked(read.bits);
  for (const std::uint32_t index : planned.points) {
    const Span span = *span_of(points[index]);
    const std::uint32_t first = std::max(span.first_bit, read.first_bit);
    const std::uint32_t end = std::min(span.end_bit(), read.end_bit());
    for (std::uint32_t bit = first; bit < end; ++bit) asked[bit - read.first_bit] = true;
  }
  return static_cast<std::uint32_t>(std::count(asked.begin(), asked.end(), true));
}

/// Characters of an exchange that do not grow with what is read.
std::uint32_t framing_chars(const Codec& codec, const Read& read, std::uint32_t unit_bits) {
  const auto chars = [&](std::uint32_t units) {
    Read shorter = read;
    shorter.span.bits = units * unit_bits;
    const LineLength length = codec.line_length(shorter);
    return length.request_chars + length.reply_chars + length.closing_chars;
  };
  // Sixteen units and thirty-two: bits go eight to a byte.
  const std::uint32_t growth = chars(32) - chars(16);
  return chars(16) - std::min(growth, chars(16));
}

void add_waste(GroupReportLine& line, const Codec& codec, const PlannedRead& planned,
               std::span<const Point> points, const LineTiming& timing) {
  std::uint32_t unit = 8;
  for (const ReadWay& way : codec.read_ways(planned.read.span.space))
    if (way.way == planned.read.way) unit = way.unit_bits;
  const LineLength length = codec.line_length(planned.read);
  const std::uint32_t all = length.request_chars + length.reply_chars + length.closing_chars;
  const std::uint32_t framing = std::min(all, framing_chars(codec, planned.read, unit));
  const double bits = planned.read.span.bits;
  const double unasked = 1.0 - asked_bits(planned, points) / bits;
  line.waste.framing += timing.char_time * framing;
  line.waste.unasked += nanoseconds(static_cast<std::int64_t>(
      static_cast<double>((timing.char_time * (all - framing)).count()) * unasked));
  line.waste.turnaround += exchange_time(codec, planned.read, timing) - timing.char_time * all;
}

/// A write of one word (or a force of one bit, where the device has no such tag) and its read-back.
nanoseconds command_time(const Codec& codec, const DeviceConfig& device, nanoseconds char_time,
                         std::uint32_t max_block_bytes) {
  const LineTiming timing = timing_of(device, char_time);
  nanoseconds longest{0};
  for (const TagConfig& tag : device.tags) {
    Point point = tag.point;
    point.count = 1;
    point.is_array = false;
    const auto span = span_of(point);
    if (!span || !point.address.writable) continue;
    const auto writes = plan_write(codec, point, Bytes((span->bits + 7) / 8));
    if (!writes) continue;
    nanoseconds total{0};
    for (const Request& request : *writes) total += exchange_time(codec, request, timing);
    for (const PlannedRead& read :
         plan_of(codec, device, std::span(&point, 1), char_time, max_block_bytes).reads)
      total += exchange_time(codec, read.read, timing);
    if (point.address.unit == Unit::word) return total;
    longest = std::max(longest, total);
  }
  return longest;
}

/// The longest exchange that a command may have to wait for.
nanoseconds longest_exchange(const Codec& codec, const DeviceConfig& device, nanoseconds char_time,
                             std::uint32_t max_block_bytes) {
  const LineTiming timing = timing_of(device, char_time);
  nanoseconds longest{0};
  for (std::uint32_t g = 0; g < device.groups.size(); ++g) {
    const auto points = points_of(device, g);
    for (const PlannedRead& read : plan_of(codec, device, points, char_time, max_block_bytes).reads)
      longest = std::max(longest, exchange_time(codec, read.read, timing));
  }
  if (const auto question = codec.run_state())
    longest = std::max(longest, exchange_time(codec, *question, timing));
  return longest;
}

GroupReportLine report_group(const DeviceConfig& device, std::uint32_t group, const Codec& codec,
                             nanoseconds char_time) {
  GroupReportLine line;
  line.device = device.name;
  line.group = device.groups[group].name;
  line.interval = device.groups[group].interval;
  const auto points = points_of(device, group);
  const LineTiming timing = timing_of(device, char_time);
  const Plan plan = plan_of(codec, device, points, char_time, device.max_block_bytes);
  nanoseconds total{0};
  for (const PlannedRead& planned : plan.reads) {
    ExchangeReport exchange;
    exchange.address = codec.name_of(planned.read.span);
    exchange.bytes = (planned.read.span.bits + 7) / 8;
    if (char_time.count() > 0) {
      exchange.line_time = exchange_time(codec, planned.read, timing);
      total += *exchange.line_time;
      add_waste(line, codec, planned, points, timing);
    }
    line.exchanges.push_back(std::move(exchange));
  }
  if (char_time.count() > 0) line.line_time = total;
  return line;
}

std::string number_text(double value) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.1f", value);
  return text;
}

LinkReport report_link(const Config& config, std::uint32_t index) {
  const LinkConfig& link = config.links[index];
  LinkReport report;
  report.name = link.name;
  if (const auto* serial = std::get_if<SerialSettings>(&link.channel))
    report.baud = serial->baud;
  else if (const int baud = std::get<TcpSettings>(link.channel).line_baud; baud > 0)
    report.baud = baud;
  const nanoseconds char_time = link.char_time;
  const bool known = char_time.count() > 0;
  double load = 0;
  nanoseconds longest{0};
  nanoseconds own{0};
  for (const DeviceConfig& device : config.devices) {
    if (device.link != index) continue;
    const auto codec = widest(device);
    if (codec != device.codec)
      report.warnings.push_back(device.name + ": model auto, planned as " + codec->model() +
                                ", the widest");
    for (std::uint32_t g = 0; g < device.groups.size(); ++g) {
      if (points_of(device, g).empty()) continue;
      report.groups.push_back(report_group(device, g, *codec, char_time));
      const GroupReportLine& line = report.groups.back();
      if (line.line_time && line.interval.count() > 0)
        load += static_cast<double>(line.line_time->count()) /
                static_cast<double>(nanoseconds(line.interval).count());
      if (line.interval.count() == 0)
        report.warnings.push_back(line.device + "/" + line.group +
                                  ": no interval, it takes what the others leave");
    }
    if (const auto question = codec->run_state())
      load += static_cast<double>(
                  exchange_time(*codec, *question, timing_of(device, char_time)).count()) /
              static_cast<double>(nanoseconds(kRunStateEvery).count());
    longest =
        std::max(longest, longest_exchange(*codec, device, char_time, device.max_block_bytes));
    own = std::max(own, command_time(*codec, device, char_time, device.max_block_bytes));
  }
  if (!known) {
    report.warnings.emplace_back(
        "the speed of this line is not known, so no times are: give line_baud where a serial line "
        "is behind it");
    return report;
  }
  report.busy_percent = 100 * load;
  report.command_bound = longest + own;
  for (GroupReportLine& line : report.groups) {
    if (line.interval.count() == 0) continue;
    line.shortest_interval = milliseconds(
        static_cast<std::int64_t>(std::ceil(static_cast<double>(line.interval.count()) * load)));
    if (load > 1)
      report.warnings.push_back(
          line.device + "/" + line.group + " asks for " + std::to_string(line.interval.count()) +
          " ms; with all groups of this line it carries " +
          std::to_string(line.shortest_interval->count()) + " ms: set interval_ms to that or more");
  }
  for (const DeviceConfig& device : config.devices) {
    if (device.link != index || device.tags.empty()) continue;
    const auto codec = widest(device);
    nanoseconds of_others{0};
    for (const DeviceConfig& other : config.devices)
      if (other.link == index && &other != &device)
        of_others = std::max(
            of_others, longest_exchange(*widest(other), other, char_time, other.max_block_bytes));
    for (const std::uint32_t bytes : kBlockSizes) {
      BlockTrade trade;
      trade.device = device.name;
      trade.max_block_bytes = bytes;
      for (std::uint32_t g = 0; g < device.groups.size(); ++g)
        for (const PlannedRead& read :
             plan_of(*codec, device, points_of(device, g), char_time, bytes).reads)
          trade.cycle += exchange_time(*codec, read.read, timing_of(device, char_time));
      trade.command_bound =
          std::max(of_others, longest_exchange(*codec, device, char_time, bytes)) +
          command_time(*codec, device, char_time, bytes);
      report.block_trade.push_back(std::move(trade));
    }
  }
  return report;
}

// ---- printing -----------------------------------------------------------------------------------

Json time_json(const std::optional<nanoseconds>& duration) {
  return duration ? Json(ms(*duration)) : Json(nullptr);
}

Json to_json(const std::vector<LinkReport>& links) {
  Json out;
  out["links"] = Json::array();
  for (const LinkReport& link : links) {
    Json l;
    l["name"] = link.name;
    l["baud"] = link.baud ? Json(*link.baud) : Json(nullptr);
    l["busy_percent"] =
        link.busy_percent ? Json(std::round(*link.busy_percent * 10) / 10) : Json(nullptr);
    l["command_bound_ms"] = time_json(link.command_bound);
    l["groups"] = Json::array();
    for (const GroupReportLine& group : link.groups) {
      Json g;
      g["device"] = group.device;
      g["group"] = group.group;
      g["interval_ms"] = group.interval.count();
      g["line_ms"] = time_json(group.line_time);
      g["shortest_interval_ms"] =
          group.shortest_interval ? Json(group.shortest_interval->count()) : Json(nullptr);
      if (group.line_time)
        g["waste_ms"] = {{"framing", ms(group.waste.framing)},
                         {"unasked", ms(group.waste.unasked)},
                         {"turnaround", ms(group.waste.turnaround)}};
      g["exchanges"] = Json::array();
      for (const ExchangeReport& exchange : group.exchanges)
        g["exchanges"].push_back({{"address", exchange.address},
                                  {"bytes", exchange.bytes},
                                  {"line_ms", time_json(exchange.line_time)}});
      l["groups"].push_back(std::move(g));
    }
    l["block_trade"] = Json::array();
    for (const BlockTrade& trade : link.block_trade)
      l["block_trade"].push_back(
          {{"device", trade.device},
           {"max_block_bytes",
            trade.max_block_bytes != 0 ? Json(trade.max_block_bytes) : Json("protocol")},
           {"cycle_ms", ms(trade.cycle)},
           {"command_bound_ms", ms(trade.command_bound)}});
    l["warnings"] = link.warnings;
    out["links"].push_back(std::move(l));
  }
  return out;
}

std::string time_text(const std::optional<nanoseconds>& duration) {
  return duration ? number_text(ms(*duration)) + " ms" : "?";
}

void print_text(const std::vector<LinkReport>& links) {
  for (const LinkReport& link : links) {
    std::cout << "link " << link.name;
    if (link.baud) std::cout << ", " << *link.baud << " baud";
    if (link.busy_percent)
      std::cout << ": busy " << number_text(*link.busy_percent) << " %, a command is through after "
                << time_text(link.command_bound) << " at the most";
    std::cout << '\n';
    for (const GroupReportLine& group : link.groups) {
      std::cout << "  " << group.device << '/' << group.group << ": "
                << (group.interval.count() > 0
                        ? "each " + std::to_string(group.interval.count()) + " ms"
                        : std::string("as fast as the line allows"))
                << ", " << group.exchanges.size() << " exchanges, " << time_text(group.line_time);
      if (group.shortest_interval)
        std::cout << ", the line carries " << group.shortest_interval->count() << " ms";
      std::cout << '\n';
      for (const ExchangeReport& exchange : group.exchanges)
        std::cout << "    " << exchange.address << ", " << exchange.bytes
                  << " bytes: " << time_text(exchange.line_time) << '\n';
      if (group.line_time)
        std::cout << "    of that " << number_text(ms(group.waste.framing)) << " ms framing, "
                  << number_text(ms(group.waste.unasked)) << " ms that nobody asked for, "
                  << number_text(ms(group.waste.turnaround)) << " ms turnaround and gaps\n";
    }
    for (std::size_t i = 0; i < link.block_trade.size(); ++i) {
      const BlockTrade& trade = link.block_trade[i];
      const bool first = i == 0 || link.block_trade[i - 1].device != trade.device;
      if (first) std::cout << "  " << trade.device << ", max_block_bytes";
      std::cout << (first ? " " : "; ")
                << (trade.max_block_bytes != 0 ? std::to_string(trade.max_block_bytes)
                                               : std::string("of the protocol"))
                << ": cycle " << time_text(trade.cycle) << ", bound "
                << time_text(trade.command_bound);
      if (i + 1 == link.block_trade.size() || link.block_trade[i + 1].device != trade.device)
        std::cout << '\n';
    }
    for (const std::string& warning : link.warnings) std::cout << "  warning: " << warning << '\n';
  }
}

tl::unexpected<Error> refuse(std::string text) {
  return fail(ErrorCode::bad_request, std::move(text));
}

}  // namespace

std::vector<LinkReport> plan_links(const Config& config) {
  std::vector<LinkReport> links;
  for (std::uint32_t i = 0; i < config.links.size(); ++i) links.push_back(report_link(config, i));
  return links;
}

Result<void> add_what_if(Config& config, const std::string& what) {
  const auto blank = what.find(' ');
  const auto at = what.rfind('@');
  if (blank == std::string::npos || at == std::string::npos || at < blank)
    return refuse("'" + what + "': write DEVICE FIRST..LAST@MS, as in press1 D500..D563@200");
  const std::string name = what.substr(0, blank);
  const auto device = std::find_if(config.devices.begin(), config.devices.end(),
                                   [&](const DeviceConfig& d) { return d.name == name; });
  if (device == config.devices.end()) return refuse("there is no device " + name);
  std::int64_t interval = 0;
  const char* end = what.data() + what.size();
  const auto [stop, error] = std::from_chars(what.data() + at + 1, end, interval);
  if (error != std::errc{} || stop != end || interval < 0 || interval > 86400000)
    return refuse("'" + what + "': the interval behind @ is 0 to 86400000 ms");
  std::string places = what.substr(blank + 1, at - blank - 1);
  const auto dots = places.find("..");
  const std::string first_text = places.substr(0, dots);
  const std::string last_text = dots == std::string::npos ? first_text : places.substr(dots + 2);
  const auto codec = widest(*device);
  const auto first = codec->parse_address(first_text, std::nullopt);
  if (!first) return tl::make_unexpected(first.error());
  const auto last = codec->parse_address(last_text, std::nullopt);
  if (!last) return tl::make_unexpected(last.error());
  const Span from = first->span;
  const Span to = last->span;
  if (from.space != to.space || to.first_bit < from.first_bit || from.bits != to.bits)
    return refuse("'" + places + "': both ends are of one kind, the lower one first");
  TagConfig tag;
  tag.name = "what-if";
  tag.point.address = *first;
  tag.point.type = default_type(*first);
  tag.point.order = codec->default_order();
  tag.point.count = static_cast<std::uint16_t>((to.end_bit() - from.first_bit) / from.bits);
  tag.point.is_array = tag.point.count > 1;
  if (const auto inside = codec->check_range(*span_of(tag.point)); !inside)
    return tl::make_unexpected(inside.error());
  auto group =
      std::find_if(device->groups.begin(), device->groups.end(),
                   [&](const GroupConfig& g) { return g.interval == milliseconds(interval); });
  if (group == device->groups.end()) {
    GroupConfig made;
    made.name = "what-if";
    made.interval = milliseconds(interval);
    group = device->groups.insert(device->groups.end(), made);
  }
  tag.group = static_cast<std::uint32_t>(group - device->groups.begin());
  device->tags.push_back(std::move(tag));
  return {};
}

int run_plan(const Config& config, const std::vector<std::string>& what_ifs, bool as_json) {
  Config changed = config;
  for (const std::string& what : what_ifs) {
    if (const auto added = add_what_if(changed, what); !added) {
      std::cerr << "--what-if: " << added.error().text << '\n';
      return 2;
    }
  }
  const auto before = plan_links(config);
  if (what_ifs.empty()) {
    if (as_json)
      std::cout << to_json(before).dump() << '\n';
    else
      print_text(before);
    return 0;
  }
  const auto after = plan_links(changed);
  if (as_json) {
    std::cout << Json({{"before", to_json(before)}, {"after", to_json(after)}}).dump() << '\n';
  } else {
    std::cout << "before\n";
    print_text(before);
    std::cout << "after\n";
    print_text(after);
  }
  return 0;
}

}  // namespace fxagent
