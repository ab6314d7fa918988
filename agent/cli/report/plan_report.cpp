#include "agent/cli/report/plan_report.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "agent/config/suggestions.h"
#include "agent/line_time.h"
#include "agent/text/text.h"
#include "protocol/plan/plan.h"
#include "protocol/plc.h"
#include "protocol/range_ends.h"

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;

// Block sizes tried in addition to the configured one and the protocol's maximum.
constexpr std::uint32_t kBlockSizes[] = {16, 32, 64};
constexpr std::int64_t kLongestInterval = config_key("devices[].groups[].interval_ms").limits.max;

double ratio(nanoseconds part, nanoseconds whole) {
  return static_cast<double>(part.count()) / static_cast<double>(whole.count());
}

nanoseconds part_of(nanoseconds whole, double part) {
  return nanoseconds(static_cast<std::int64_t>(static_cast<double>(whole.count()) * part));
}

// ---- one device ---------------------------------------------------------------------------------

/// Returns the device's codec, or that of the widest model if the model is unknown.
std::shared_ptr<const Codec> widest(const DeviceConfig& device) {
  return widest_of(*device.protocol, device.codec);
}

/// Polls of a device as the field will send them.
struct DevicePlan {
  std::shared_ptr<const Codec> codec;
  LineTiming timing;
  std::vector<GroupPlan> groups;  ///< groups with tags

  nanoseconds longest_exchange() const {
    std::vector<const Plan*> plans;
    plans.reserve(groups.size());
    for (const GroupPlan& group : groups) plans.push_back(&group.plan);
    return longest_poll(*codec, plans, timing);
  }
  nanoseconds time_of(const GroupPlan& group) const {
    return poll_time(*codec, group.plan, timing);
  }
};

DevicePlan plan_device(const DeviceConfig& device, nanoseconds char_time) {
  const auto codec = widest(device);
  return {codec, timing_of(device, char_time), group_plans(*codec, device, char_time)};
}

/// Rank of a place as an example for the bound, lowest first: words, double words, bits; within
/// each, places that the config allows to write come first. nullopt: such a place is never written
/// alone.
std::optional<int> rank_of(const Point& point, bool allowed) {
  const int second = allowed ? 0 : 1;
  switch (point.address.unit) {
    case Unit::word:
      return 0 + second;
    case Unit::dword:
    case Unit::long_index:
    case Unit::long_count:
      return 2 + second;
    case Unit::bit:
      return 4 + second;
    default:
      return std::nullopt;
  }
}

/// Returns the bus time of the longest command for one place; for words including the read-back.
/// nullopt: the config names no writable place of the device.
std::optional<nanoseconds> command_time(const DeviceConfig& device, const DevicePlan& plan) {
  std::optional<nanoseconds> longest;
  int best = 0;
  const auto consider = [&](const Address& address, bool allowed) {
    const Point point{.address = address, .type = default_type(address)};
    const auto rank = rank_of(point, allowed);
    const auto span = span_of(point);
    if (!rank || !span || (longest && *rank > best)) return;
    const auto writes = plan_write(*plan.codec, point, Bytes((span->bits + 7) / 8));
    if (!writes) return;
    nanoseconds time = write_time(*plan.codec, *writes, plan.timing);
    if (point.type != DataType::boolean)
      time += read_time(*plan.codec, device, point, {}, plan.timing);
    longest = longest && *rank == best ? std::max(*longest, time) : time;
    best = *rank;
  };
  for (const TagConfig& tag : device.tags) consider(tag.point.address, tag.writable);
  const AddressSpace& addresses = plan.codec->addresses();
  const auto address_at = [&](const Span& span) {
    return addresses.parse_address(addresses.name_of(span), std::nullopt);
  };
  for (const Span& span : device.commands.allow) {
    const auto first = address_at(span);
    if (!first) continue;
    consider(*first, true);
    // Higher addresses may take longer frames than lower ones, never shorter ones.
    const std::uint32_t bits = first->span.bits;
    if (const auto last = address_at({span.space, span.end_bit() - bits, bits}))
      consider(*last, true);
  }
  return longest;
}

// ---- breakdown of the time of a cycle -----------------------------------------------------------

/// Bits of one read by purpose.
struct BitUse {
  std::uint32_t asked = 0;
  std::uint32_t word_access = 0;  ///< next to a requested bit of a bit device, in the same unit
};

BitUse bit_use(const PlannedRead& planned, std::span<const Point> points, std::uint32_t unit) {
  enum class Mark : std::uint8_t { none, word, bit };
  const Span& read = planned.read.span;
  std::vector<Mark> marks(read.bits, Mark::none);
  for (const std::uint32_t index : planned.points) {
    const Point& point = points[index];
    const bool is_bits = point.address.unit == Unit::bit || point.address.unit == Unit::bit_group;
    const Span span = *span_of(point);
    const std::uint32_t end = std::min(span.end_bit(), read.end_bit());
    for (std::uint32_t bit = std::max(span.first_bit, read.first_bit); bit < end; ++bit)
      marks[bit - read.first_bit] = is_bits ? Mark::bit : Mark::word;
  }
  BitUse use;
  for (std::uint32_t at = 0; at < read.bits; at += unit) {
    const auto part = std::span(marks).subspan(at, std::min(unit, read.bits - at));
    const auto none = static_cast<std::uint32_t>(std::ranges::count(part, Mark::none));
    use.asked += static_cast<std::uint32_t>(part.size()) - none;
    if (std::ranges::count(part, Mark::bit) > 0) use.word_access += none;
  }
  return use;
}

std::uint32_t unit_of(const Codec& codec, const Read& read) {
  for (const ReadWay& way : codec.addresses().read_ways(read.span.space))
    if (way.way == read.way) return way.unit_bits;
  return 8;
}

/// Returns the reply characters that grow with the data; for a part of a Gather, all that it adds.
std::uint32_t data_chars(const Codec& codec, const Read& read, std::uint32_t unit) {
  const auto reply_of = [&](const Request& request) {
    return codec.line_length(request).reply_chars;
  };
  if (read.gather != 0) {
    // Measured with the shortest parts: a frame may not hold two parts like this one.
    Read shortest = read;
    shortest.span.bits = unit;
    const std::uint32_t envelope =
        2 * reply_of(Gather{{shortest}}) - reply_of(Gather{{shortest, shortest}});
    return reply_of(Gather{{read}}) - envelope;
  }
  const auto reply_of_units = [&](std::uint32_t units) {
    Read other = read;
    other.span.bits = units * unit;
    return reply_of(other);
  };
  // Compares 16 units with 32, because bits may be packed eight to a byte.
  const std::uint32_t envelope = 2 * reply_of_units(16) - reply_of_units(32);
  return reply_of(read) - envelope;
}

std::uint32_t chars_of(const LineLength& length) {
  return length.request_chars + length.reply_chars + length.closing_chars;
}

/// Distributes the data characters of one read over `use`. Returns their number.
std::uint32_t add_use(const DevicePlan& device, const PlannedRead& planned,
                      std::span<const Point> points, LineTimeUse& use) {
  const std::uint32_t unit = unit_of(*device.codec, planned.read);
  const std::uint32_t data = data_chars(*device.codec, planned.read, unit);
  const std::uint32_t of_read = planned.read.span.bits;
  const BitUse bits = bit_use(planned, points, unit);
  const nanoseconds data_time = device.timing.char_time * data;
  const nanoseconds asked = part_of(data_time, static_cast<double>(bits.asked) / of_read);
  const nanoseconds beside = part_of(data_time, static_cast<double>(bits.word_access) / of_read);
  use.asked += asked;
  use.word_access += beside;
  use.unasked +=
      bits.asked + bits.word_access < of_read ? data_time - asked - beside : nanoseconds(0);
  return data;
}

ExchangeReport report_exchange(const DevicePlan& device, const Plan& plan, ReadIndices which,
                               std::span<const Point> points, LineTimeUse& use) {
  const Codec& codec = *device.codec;
  const LineTiming& timing = device.timing;
  const Request request = plan.request(which);
  ExchangeReport out;
  out.gathered = std::holds_alternative<Gather>(request);
  for (const std::uint32_t read : which) {
    const Span& span = plan.reads[read].read.span;
    out.addresses.push_back(codec.addresses().name_of(span));
    out.bits += span.bits;
  }
  const LineLength length = codec.line_length(request);
  out.chars = chars_of(length);
  if (const auto enquiry = codec.resync(); enquiry && timing.enquires_always)
    out.chars += chars_of(codec.line_length(*enquiry));
  if (timing.char_time.count() == 0) return out;
  out.line_time =
      exchange_time(codec, request, timing) - timing.char_time * length.more_reply_chars;
  std::uint32_t data = 0;
  for (const std::uint32_t read : which) data += add_use(device, plan.reads[read], points, use);
  use.framing += timing.char_time * (out.chars - data);
  use.turnaround += *out.line_time - timing.char_time * out.chars;
  return out;
}

// ---- one link -----------------------------------------------------------------------------------

std::optional<int> baud_of(const LinkConfig& link) {
  if (const auto* serial = std::get_if<SerialSettings>(&link.channel)) return serial->baud;
  const auto* tcp = std::get_if<TcpSettings>(&link.channel);
  const int baud = tcp != nullptr ? tcp->line_baud : 0;
  return baud > 0 ? std::optional(baud) : std::nullopt;
}

/// Contribution of one device to the bound of its link.
struct BoundShare {
  nanoseconds longest{0};              ///< longest exchange that a command may have to wait for
  std::optional<nanoseconds> command;  ///< of this device
};

/// Returns the bound of a command that finds no other queued, computed as the link's worker does.
std::optional<nanoseconds> bound_of(const std::vector<BoundShare>& shares) {
  nanoseconds longest{0};
  std::optional<nanoseconds> command;
  for (const BoundShare& share : shares) {
    longest = std::max(longest, share.longest);
    if (share.command) command = std::max(command.value_or(nanoseconds(0)), *share.command);
  }
  if (!command) return std::nullopt;
  return longest + *command;
}

/// Returns the device with another max_block_bytes.
DeviceConfig with_blocks(const DeviceConfig& device, std::uint32_t bytes) {
  DeviceConfig out = device;
  out.max_block_bytes = bytes;
  Options options = *device.options;
  const auto option = options.find("max_block_bytes");
  if (option == options.end()) return out;  // only the planner uses it
  option->second = std::int64_t{bytes};
  if (const auto codec = device.protocol->make(options)) out.codec = *codec;
  return out;
}

/// Returns the maximum bytes of one read of the device's tags, ignoring the configured
/// max_block_bytes.
std::uint32_t most_bytes(const DeviceConfig& device) {
  const OptionSpec* limit = option_named(*device.protocol, "max_block_bytes");
  const auto codec =
      widest(with_blocks(device, limit == nullptr ? 0 : static_cast<std::uint32_t>(limit->max)));
  std::set<std::uint16_t> spaces;
  for (const TagConfig& tag : device.tags) spaces.insert(tag.point.address.span.space);
  std::uint32_t most = 0;
  for (const std::uint16_t space : spaces)
    for (const ReadWay& way : codec->addresses().read_ways(space))
      most = std::max(most, way.max_bits / 8);
  return most;
}

/// `shares` belong to all devices of the link; `own` is the index of this device in it.
void add_block_trade(const DeviceConfig& device, nanoseconds char_time,
                     const std::vector<BoundShare>& shares, std::size_t own, LinkReport& report) {
  const std::uint32_t most = most_bytes(device);
  const std::uint32_t now =
      device.max_block_bytes == 0 ? most : std::min(device.max_block_bytes, most);
  std::set<std::uint32_t> sizes{now, most};
  for (const std::uint32_t size : kBlockSizes)
    if (size < most) sizes.insert(size);
  for (const std::uint32_t size : sizes) {
    const DeviceConfig resized = with_blocks(device, size);
    const DevicePlan plan = plan_device(resized, char_time);
    nanoseconds cycle{0};
    for (const GroupPlan& group : plan.groups) cycle += plan.time_of(group);
    auto others = shares;
    others[own] = {plan.longest_exchange(), command_time(resized, plan)};
    report.block_trade.push_back({device.name, size, size == now, cycle, bound_of(others)});
  }
}

/// Rounds up to an interval that an engineer would write into a config.
std::int64_t round_interval(milliseconds interval) {
  const std::int64_t step = interval.count() >= 100 ? 10 : 1;
  return (interval.count() + step - 1) / step * step;
}

/// A link, and the shares of its bus that poll intervals and background questions ask for.
struct LinkLoad {
  LinkReport report;
  double asked = 0;
  double fixed = 0;
};

/// Adds the groups of a device, without their exchanges.
void add_load(const DeviceConfig& device, const DevicePlan& plan, LinkLoad& load) {
  for (const GroupPlan& group : plan.groups) {
    GroupLoad& of_group = load.report.groups.emplace_back();
    of_group.device = device.name;
    of_group.group = device.groups[group.group].name;
    of_group.interval = device.groups[group.group].interval;
    if (plan.timing.char_time.count() == 0) continue;
    of_group.line_time = plan.time_of(group);
    if (of_group.interval.count() > 0) load.asked += ratio(*of_group.line_time, of_group.interval);
  }
  if (const auto question = background_question(*plan.codec, !device.tags.empty()))
    load.fixed += ratio(exchange_time(*plan.codec, *question, plan.timing), kQuestionInterval);
}

void judge_intervals(LinkLoad& load) {
  auto& [report, asked, fixed] = load;
  for (GroupLoad& group : report.groups) {
    if (group.interval.count() == 0 || fixed >= 1) continue;
    const double shortest = static_cast<double>(group.interval.count()) * asked / (1 - fixed);
    group.shortest_interval = milliseconds(static_cast<std::int64_t>(std::ceil(shortest)));
    if (asked + fixed <= 1) continue;
    report.warnings.push_back(group.device + "/" + group.group + " has an interval of " +
                              std::to_string(group.interval.count()) + " ms; the link needs " +
                              std::to_string(group.shortest_interval->count()) +
                              " ms or more: set interval_ms to " +
                              std::to_string(round_interval(*group.shortest_interval)));
  }
}

LinkReport report_link(const Config& config, std::uint32_t index) {
  const LinkConfig& link = config.links[index];
  LinkLoad load;
  LinkReport& report = load.report;
  report.name = link.name;
  report.baud = baud_of(link);
  report.listening = link.listening;
  std::vector<const DeviceConfig*> devices;
  std::vector<BoundShare> shares;
  for (const DeviceConfig& device : config.devices) {
    if (device.link != index) continue;
    const DevicePlan plan = plan_device(device, link.char_time);
    if (must_ask_model(*device.codec))
      report.warnings.push_back(device.name + ": model auto, planned as " +
                                widest_name(*device.protocol));
    std::size_t at = report.groups.size();
    add_load(device, plan, load);
    for (const GroupPlan& group : plan.groups) {
      GroupLoad& out = report.groups[at++];
      for (const ReadIndices reads : group.plan.exchanges)
        out.exchanges.push_back(report_exchange(plan, group.plan, reads, group.points, out.use));
    }
    devices.push_back(&device);
    shares.push_back({plan.longest_exchange(), command_time(device, plan)});
  }
  if (link.char_time.count() == 0) {
    // A PLC's own Ethernet port has no line with a speed.
    if (std::ranges::any_of(devices,
                            [](const auto* device) { return device->protocol->on_serial; }))
      report.warnings.emplace_back(
          "no times: the speed of this line is not known; set line_baud if a serial server "
          "connects it");
    return std::move(report);
  }
  report.busy_percent = 100 * (load.asked + load.fixed);
  report.command_bound = bound_of(shares);
  judge_intervals(load);
  for (std::size_t i = 0; i < devices.size(); ++i)
    if (!devices[i]->tags.empty()) add_block_trade(*devices[i], link.char_time, shares, i, report);
  return std::move(report);
}

// ---- what if ------------------------------------------------------------------------------------

tl::unexpected<Error> refuse(const std::string& what, const std::string& why) {
  return fail(ErrorCode::bad_request, "\"" + what + "\": " + why);
}

struct WhatIf {
  std::string device;
  std::string places;
  milliseconds interval{0};
};

Result<WhatIf> parse_what_if(const std::string& what) {
  const std::string text(trimmed(what));
  const auto blank = text.find(' ');
  const auto at = text.rfind('@');
  if (blank == std::string::npos || at == std::string::npos || at < blank)
    return refuse(what, "write DEVICE FIRST..LAST@MS, as in \"press1 D500..D563@200\"");
  WhatIf out;
  out.device = text.substr(0, blank);
  const std::string number(trimmed(std::string_view(text).substr(at + 1)));
  const auto interval = number_from<std::int64_t>(number);
  if (!interval || *interval < 0 || *interval > kLongestInterval)
    return refuse(what, "the interval after @ must be 0 to " + std::to_string(kLongestInterval) +
                            " ms, not \"" + number + "\"");
  out.interval = milliseconds(*interval);
  out.places = text.substr(blank + 1, at - blank - 1);
  return out;
}

/// Returns the letters of the address: "W" of WA0; empty of hr:100 and 40101.
std::string letters_of(const AddressSpace& addresses, const Address& address) {
  // Only the protocol knows that the A is a digit. The first device of the space has only digits.
  const std::string name = addresses.name_of({address.span.space, 0, 1});
  return name.find(':') == name.npos ? name.substr(0, name.find_first_of("0123456789")) : "";
}

/// Returns one point for each device from the first to the last address.
Result<std::vector<Point>> points_between(const Codec& codec, const WhatIf& asked,
                                          const std::string& what) {
  const RangeEnds ends = range_ends(asked.places);
  const auto first = codec.addresses().parse_address(ends.first, std::nullopt);
  if (!first) return refuse(what, first.error().text);
  const std::string end = last_end(ends, letters_of(codec.addresses(), *first));
  const auto last = codec.addresses().parse_address(end, std::nullopt);
  if (!last) return refuse(what, last.error().text);
  const Span from = first->span;
  const Span to = last->span;
  const bool alike = from.space == to.space && from.bits == to.bits && first->unit == last->unit;
  if (!alike || to.first_bit < from.first_bit || (to.first_bit - from.first_bit) % from.bits != 0)
    return refuse(what, std::string(ends.first) + " and " + end +
                            " are not a range: both ends must be in one area, the lower one first");
  const Span whole{from.space, from.first_bit, to.end_bit() - from.first_bit};
  if (const auto inside = codec.addresses().check_range(whole); !inside)
    return refuse(what, inside.error().text);
  std::vector<Point> points;
  for (std::uint32_t bit = from.first_bit; bit < to.end_bit(); bit += from.bits) {
    Address address = *first;
    address.span.first_bit = bit;
    address.text = codec.addresses().name_of(address.span);
    points.push_back({.address = address,
                      .type = default_type(*first),
                      .order = codec.addresses().default_order()});
  }
  const Plan plan = make_plan(codec, points, LineCost{}, 0);
  if (!plan.unreachable.empty())
    return refuse(what, points[plan.unreachable.front()].address.text +
                            " cannot be reached with this protocol and model");
  return points;
}

/// Returns the device's first group with this interval; creates one if there is none.
std::uint32_t group_of(DeviceConfig& device, milliseconds interval) {
  auto& groups = device.groups;
  const auto same = std::ranges::find(groups, interval, &GroupConfig::interval);
  if (same != groups.end()) return static_cast<std::uint32_t>(same - groups.begin());
  const bool is_taken = contains(groups, "what-if", &GroupConfig::name);
  GroupConfig& group = groups.emplace_back();
  group.name = is_taken ? "what-if-" + std::to_string(interval.count()) : "what-if";
  group.interval = interval;
  return static_cast<std::uint32_t>(groups.size() - 1);
}

}  // namespace

std::vector<std::string> overloads(const Config& config) {
  std::vector<LinkLoad> loads(config.links.size());
  for (const DeviceConfig& device : config.devices)
    if (const nanoseconds char_time = config.links[device.link].char_time; char_time.count() > 0)
      add_load(device, plan_device(device, char_time), loads[device.link]);
  std::vector<std::string> found;
  for (std::size_t i = 0; i < loads.size(); ++i) {
    judge_intervals(loads[i]);
    for (const std::string& warning : loads[i].report.warnings)
      found.push_back(config.links[i].name + ": " + warning);
  }
  return found;
}

std::vector<LinkReport> plan_links(const Config& config) {
  std::vector<LinkReport> links;
  links.reserve(config.links.size());
  for (std::uint32_t i = 0; i < config.links.size(); ++i) links.push_back(report_link(config, i));
  return links;
}

Result<void> add_what_if(Config& config, const std::string& what) {
  const auto asked = parse_what_if(what);
  if (!asked) return tl::make_unexpected(asked.error());
  const auto device = std::ranges::find(config.devices, asked->device, &DeviceConfig::name);
  if (device == config.devices.end())
    return refuse(what, "there is no device " + asked->device +
                            in_place_of(asked->device, names_in(config.devices)));
  const auto codec = widest(*device);
  if (codec->is_broadcast())
    return refuse(what, device->name + " is a broadcast, and no unit answers one");
  const auto points = points_between(*codec, *asked, what);
  if (!points) return tl::make_unexpected(points.error());
  const std::uint32_t group = group_of(*device, asked->interval);
  for (const Point& point : *points)
    device->tags.push_back({.name = "what-if", .point = point, .group = group});
  return {};
}

}  // namespace fxagent
