#include "agent/config/config_difference.h"

#include <algorithm>
#include <iterator>
#include <map>
#include <string_view>
#include <utility>

#include "agent/config/config_error.h"
#include "agent/config/json/tree.h"

namespace fxagent {
namespace {

using Indices = std::vector<std::uint32_t>;

constexpr std::size_t kMostNamed = 5;

template <class List>
std::map<std::string_view, std::uint32_t> by_name(const List& list) {
  std::map<std::string_view, std::uint32_t> index;
  for (std::uint32_t i = 0; i < list.size(); ++i)
    if (!list[i].is_vacant()) index.emplace(list[i].name, i);
  return index;
}

/// Returns the place of each item of `wanted` in the next list; see ConfigChange::config.
template <class List>
Indices places_of(const List& wanted, const List& running) {
  const auto known = by_name(running);
  std::vector<bool> taken(running.size() + wanted.size(), false);
  Indices places(wanted.size());
  for (std::uint32_t i = 0; i < wanted.size(); ++i)
    if (const auto found = known.find(wanted[i].name); found != known.end()) {
      places[i] = found->second;
      taken[found->second] = true;
    }
  // The place of a removed item is vacant by the time that a new one takes it.
  std::uint32_t next = 0;
  for (std::uint32_t i = 0; i < wanted.size(); ++i) {
    if (known.contains(wanted[i].name)) continue;
    while (taken[next]) ++next;
    places[i] = next++;
  }
  return places;
}

std::size_t size_for(const Indices& places) {
  return places.empty() ? 0 : *std::ranges::max_element(places) + std::size_t{1};
}

/// True if an open link can apply the remaining differences without closing.
bool is_same_line(const LinkConfig& a, const LinkConfig& b) {
  return a.name == b.name && a.channel == b.channel && a.char_time == b.char_time;
}

template <class List>
bool has(const List& list, std::uint32_t place) {
  return place < list.size() && !list[place].is_vacant();
}

void compare_links(const Config& running, ConfigChange& change) {
  const auto& before = running.links;
  const auto& after = std::as_const(change.config).links;
  for (std::uint32_t i = 0; i < std::max(before.size(), after.size()); ++i) {
    const bool was = has(before, i);
    const bool is = has(after, i);
    const bool goes_on = was && is && is_same_line(before[i], after[i]);
    if (was && !goes_on) change.links_end.push_back(i);
    if (is && !goes_on) change.links_begin.push_back(i);
    if (goes_on && before[i] != after[i]) change.links_adjusted.push_back(i);
  }
}

/// True if a running device can apply the differences: its groups are the same but for interval,
/// publish and max_silent.
bool is_same_but_for_polls(const DeviceConfig& a, const DeviceConfig& b) {
  if (!std::ranges::equal(a.groups, b.groups, {}, &GroupConfig::name, &GroupConfig::name))
    return false;
  DeviceConfig like_b = a;
  like_b.groups = b.groups;
  return like_b == b;
}

void compare_devices(const Config& running, ConfigChange& change) {
  const auto& before = running.devices;
  const SharedList<DeviceConfig>& after = change.config.devices;
  const auto link_ends = [&change](std::uint32_t link) {
    return std::ranges::binary_search(change.links_end, link);
  };
  for (std::uint32_t i = 0; i < std::max(before.size(), after.size()); ++i) {
    const bool was = has(before, i);
    const bool is = has(after, i);
    const bool stays = was && is && !link_ends(before[i].link);
    const bool same = stays && before[i] == after[i];
    const bool goes_on = same || (stays && is_same_but_for_polls(before[i], after[i]));
    if (was && !goes_on) change.devices_end.push_back(i);
    if (was && !(is && before[i].name == after[i].name))
      change.devices_gone.push_back(before[i].name);
    if (is && !goes_on) change.devices_begin.push_back(i);
    if (!goes_on) continue;
    if (same) {
      change.config.devices.share(i, before, i);
    } else {
      change.devices_adjusted.push_back(i);
      // The field keeps the device of before. This one shares its tags.
      change.config.devices[i].tags = before[i].tags;
    }
  }
}

std::string names(const Indices& indices, const SharedList<DeviceConfig>& devices) {
  std::string text = std::to_string(indices.size());
  for (std::size_t i = 0; i < indices.size() && i < kMostNamed; ++i)
    text += (i == 0 ? " (" : " ") + devices[indices[i]].name;
  if (indices.size() > kMostNamed) text += " …";
  return indices.empty() ? text : text + ")";
}

/// Sets the line of each error: that of its setting in `file`, or of the section that lacks it.
void add_lines(std::vector<ConfigError>& errors, std::string_view file) {
  const auto tree = ConfigTree::parse(file, ConfigTree::Folding::tags, {}, Comments::allowed);
  if (!tree) return;
  for (ConfigError& error : errors) error.line = tree->line_of(tree->nearest(error.pointer).offset);
}

}  // namespace

ConfigChange change_between(const Config& running, Config wanted) {
  ConfigChange change;
  const SharedVector<LinkConfig> links = std::exchange(wanted.links, {});
  SharedList<DeviceConfig> devices = std::exchange(wanted.devices, {});
  change.config = std::move(wanted);

  const Indices link_places = places_of(links, running.links);
  change.config.links.resize(size_for(link_places));
  for (std::size_t i = 0; i < links.size(); ++i) change.config.links[link_places[i]] = links[i];

  const Indices places = places_of(devices, running.devices);
  change.config.devices.resize(size_for(places));
  for (std::size_t i = 0; i < places.size(); ++i) {
    const std::uint32_t link = link_places.at(std::as_const(devices)[i].link);
    if (link != std::as_const(devices)[i].link) devices[i].link = link;
    change.config.devices.share(places[i], devices, i);
  }
  compare_links(running, change);
  compare_devices(running, change);
  change.mqtt = running.mqtt != change.config.mqtt;
  change.remote = running.remote != change.config.remote;
  return change;
}

std::vector<ConfigError> needs_restart(const Config& running, const Config& wanted,
                                       std::string_view file) {
  std::vector<ConfigError> errors;
  const auto must_stay = [&errors](std::string pointer, bool same, const std::string& in_force) {
    if (!same)
      errors.push_back({std::move(pointer), 0,
                        "needs a restart of the agent: restart it, or put back " + in_force});
  };
  must_stay("/agent/id", running.id == wanted.id, shown(running.id));
  must_stay("/agent/root", running.root == wanted.root, shown(running.root));
  must_stay("/brokers", running.brokers == wanted.brokers, "what it was at the start");
  must_stay("/profiles", running.profiles == wanted.profiles, "what it was at the start");
  const StoreConfig& is = running.store;
  const StoreConfig& next = wanted.store;
  must_stay("/store/path", is.path == next.path, is.path.empty() ? "no store" : shown(is.path));
  must_stay("/store/max_bytes", is.max_bytes == next.max_bytes, std::to_string(is.max_bytes));
  must_stay("/store/max_age_h", is.max_age == next.max_age, std::to_string(is.max_age.count()));
  must_stay("/store/sync", is.sync_always == next.sync_always,
            is.sync_always ? "\"always\"" : "\"offline\"");
  must_stay("/store/audit_max_bytes", is.audit_max_bytes == next.audit_max_bytes,
            std::to_string(is.audit_max_bytes));
  must_stay("/store/audit_max_age_h", is.audit_max_age == next.audit_max_age,
            std::to_string(is.audit_max_age.count()));
  const std::optional<HttpConfig>& server = wanted.http ? wanted.http : running.http;
  must_stay(server && server->page ? "/http/listen" : "/metrics/listen",
            running.http == wanted.http,
            running.http ? "the address at the start" : "no HTTP server");
  must_stay("/recorder", running.recorder == wanted.recorder,
            running.recorder ? "the recorder of the start" : "no recorder");
  // Another broker would have a lease of its own.
  must_stay("/mqtt", !running.pair || running.mqtt == wanted.mqtt,
            "the broker of the pair's lease at the start");
  must_stay("/pair", running.pair == wanted.pair,
            running.pair ? "the pair of the start" : "no pair");
  if (!errors.empty()) add_lines(errors, file);
  return errors;
}

std::string to_string(const ConfigChange& change, const Config& running) {
  if (change.empty()) return "nothing";
  // A device that ends and begins at the same place with the same name is a changed one.
  Indices anew;
  Indices fresh;
  Indices gone;
  for (const std::uint32_t device : change.devices_begin) {
    const bool was = device < running.devices.size() &&
                     running.devices[device].name == change.config.devices[device].name;
    (was ? anew : fresh).push_back(device);
  }
  std::ranges::set_difference(change.devices_end, anew, std::back_inserter(gone));
  std::string text;
  const auto add = [&text](const std::string& what) { text += (text.empty() ? "" : ", ") + what; };
  if (!anew.empty()) add("changed: " + names(anew, change.config.devices));
  if (!fresh.empty()) add("new: " + names(fresh, change.config.devices));
  if (!gone.empty()) add("gone: " + names(gone, running.devices));
  if (!change.devices_adjusted.empty())
    add("other poll settings: " + names(change.devices_adjusted, change.config.devices));
  if (!change.links_end.empty()) add("links ended: " + std::to_string(change.links_end.size()));
  if (!change.links_begin.empty()) add("links begun: " + std::to_string(change.links_begin.size()));
  if (!change.links_adjusted.empty())
    add("links adjusted: " + std::to_string(change.links_adjusted.size()));
  if (change.mqtt) add("mqtt");
  if (change.remote) add("the limits of remote config");
  return text;
}

}  // namespace fxagent
