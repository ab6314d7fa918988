#include "agent/cli/report/stream_check.h"

#include <algorithm>
#include <functional>
#include <iterator>
#include <nlohmann/json.hpp>
#include <utility>

#include "agent/config/model.h"
#include "agent/text/json.h"
#include "agent/text/text.h"
#include "agent/uplink/topics.h"

namespace fxagent {
namespace {

using SortedJson = nlohmann::json;

/// Parses `seq`: a number, or above 2^53 a string of digits.
std::optional<std::uint64_t> number_of(const SortedJson& json) {
  if (json.is_number_unsigned()) return json.get<std::uint64_t>();
  const auto* text = json.get_ptr<const std::string*>();
  return text == nullptr ? std::nullopt : number_from<std::uint64_t>(*text);
}

/// Parses JSON. Returns nullopt if it is invalid, or nested so deeply that walking it could exhaust
/// the stack.
std::optional<SortedJson> parsed(std::string_view text) {
  constexpr int deepest = 16;  // a sample needs 5
  bool too_deep = false;
  SortedJson json = SortedJson::parse(
      text.begin(), text.end(),
      [&too_deep](int depth, SortedJson::parse_event_t, SortedJson&) {
        too_deep = too_deep || depth > deepest;
        return !too_deep;
      },
      /*allow_exceptions=*/false);
  if (too_deep || json.is_discarded()) return std::nullopt;
  return json;
}

}  // namespace

/// Content of one live message, or of one row of a history message.
struct StreamCheck::Sample {
  std::uint64_t seq = 0;
  std::int64_t ts = 0;
  std::string boot;
  std::uint64_t print = 0;  ///< fingerprint; equal for equal samples, regardless of key order
  bool is_live = false;

  /// Reads a sample from `json`. Returns its fault, or an empty text if there is none.
  std::string_view read(const SortedJson& json) {
    if (!json.is_object()) return "a sample is a JSON object";
    const auto value = number_of(member(json, "seq"));
    if (!value) return "seq is not a number";
    const SortedJson& time = member(json, "ts");
    if (!time.is_number_integer()) return "ts is not a whole number";
    const SortedJson& id = member(json, "boot");
    if (!id.is_string()) return "boot is not a string";
    seq = *value;
    ts = time.get<std::int64_t>();
    boot = id.get<std::string>();
    print = std::hash<std::string>{}(dumped(json));
    return {};
  }
};

BootSkip boot_skip(const Config& config) {
  const bool keeps_numbers = !config.store.path.empty() && config.store.sync_always;
  return keeps_numbers && !config.pair ? BootSkip::is_loss : BootSkip::allowed;
}

void NumberRanges::add(NumberRange range) {
  numbers += range.last - range.first + 1;
  ++ranges;
  if (listed.size() < kMostListed) listed.push_back(range);
}

StreamCheck::StreamCheck(std::string base, const std::vector<std::string>& expected, BootSkip skip)
    : base_(std::move(base)), skip_(skip) {
  for (const std::string& name : expected) device(name).stream.expected = true;
}

StreamCheck::Device& StreamCheck::device(std::string_view name) {
  Device& found = devices_[std::string(name)];
  found.stream.device = name;
  return found;
}

void StreamCheck::take(std::string_view topic, std::string_view payload, bool retained) {
  const auto place = data_topic_of(topic, base_);
  if (!place || retained) return;
  Device& from = device(place->device);
  const auto malformed = [&from](std::string_view why) {
    if (from.stream.malformed++ == 0) from.stream.malformed_why = why;
  };
  const auto take_one = [&](const SortedJson& json) {
    Sample sample;
    sample.is_live = !place->is_history;
    const std::string_view fault = sample.read(json);
    fault.empty() ? take_sample(from, topic, sample) : malformed(fault);
  };
  const auto json = parsed(payload);
  if (!json) return malformed("not JSON, or nested too deeply");
  if (!place->is_history) return take_one(*json);
  const SortedJson& rows = member(*json, "rows");
  if (!rows.is_array()) return malformed("history without rows");
  for (const SortedJson& row : rows) take_one(row);
}

std::uint32_t StreamCheck::boot_of(Device& device, const std::string& id, std::uint64_t seq) const {
  const auto next = static_cast<std::uint32_t>(device.boots.size());
  const auto [entry, fresh] = device.boot_index.emplace(id, next);
  if (fresh) {
    device.boots.push_back({seq, seq, std::nullopt});
    device.stream.boots.push_back(id);
  }
  Boot& boot = device.boots[entry->second];
  boot.lowest = std::min(boot.lowest, seq);
  boot.highest = std::max(boot.highest, seq);
  return entry->second;
}

void StreamCheck::take_sample(Device& device, std::string_view topic, const Sample& sample) {
  DeviceStream& stream = device.stream;
  ++(sample.is_live ? stream.live : stream.history);

  // Repeat of a known number?
  auto after = device.runs.upper_bound(sample.seq);
  const auto before = after == device.runs.begin() ? device.runs.end() : std::prev(after);
  const bool has_before = before != device.runs.end();
  const std::uint64_t offset = has_before ? sample.seq - before->first : 0;
  if (has_before && offset < before->second.prints.size()) {
    ++stream.repeated;
    if (before->second.prints[static_cast<std::size_t>(offset)] != sample.print) ++stream.differing;
    return;
  }

  const std::uint32_t boot = boot_of(device, sample.boot, sample.seq);
  if (has_before && offset == before->second.prints.size() && before->second.boot == boot)
    before->second.prints.push_back(sample.print);
  else
    device.runs.emplace_hint(after, sample.seq, Run{boot, {sample.print}});
  ++stream.distinct;

  // The first live sample of the device may be in the middle of its boot. A boot that turns live
  // later began while the check listened.
  if (sample.is_live && !device.boots[boot].whole_from)
    device.boots[boot].whole_from = stream.decided ? 0 : sample.seq;
  stream.decided = stream.decided || sample.is_live;
  if (sample.is_live && std::exchange(device.awaits_live, false))
    device.proven_from = std::max(device.proven_from, sample.seq);

  const Newest own{sample.seq, sample.ts};
  Newest& newest = device.topics.try_emplace(std::string(topic), own).first->second;
  if (own.seq < newest.seq) {
    ++stream.disordered;
  } else {
    if (own.ts < newest.ts) ++stream.ts_backward;
    newest = own;
  }
}

void StreamCheck::judge(const Device& device, DeviceStream& stream) const {
  for (auto run = device.runs.begin(); run != device.runs.end(); ++run) {
    const std::uint64_t end = run->first + (run->second.prints.size() - 1);
    const auto next = std::next(run);
    stream.seen = NumberRange{device.runs.begin()->first, end};
    if (next == device.runs.end() || next->first == end + 1) continue;
    const NumberRange gap{end + 1, next->first - 1};
    const Boot& below = device.boots[run->second.boot];
    const Boot& above = device.boots[next->second.boot];
    if (!below.whole_from || end < *below.whole_from) continue;
    // The sample at proven_from has arrived: each gap is wholly below it or above.
    if (device.awaits_live || gap.last < device.proven_from) {
      stream.unprovable.add(gap);
      continue;
    }
    const bool between_boots =
        &below != &above && below.highest == end && above.lowest == next->first;
    if (between_boots && skip_ == BootSkip::allowed)
      stream.skipped.add(gap);
    else
      stream.missing.add(gap);
  }
}

void StreamCheck::interrupted() {
  for (auto& [name, device] : devices_) device.awaits_live = true;
}

std::vector<DeviceStream> StreamCheck::report() const {
  std::vector<DeviceStream> list;
  for (const auto& [name, device] : devices_) {
    list.push_back(device.stream);
    judge(device, list.back());
  }
  return list;
}

}  // namespace fxagent
