#include "agent/remote/named_ranges.h"

#include <algorithm>
#include <optional>
#include <string_view>
#include <utility>

#include "protocol/fx/port_map.h"
#include "protocol/plc.h"

namespace fxagent {
namespace {

/// Device numbers from `first` to before `end`.
struct Run {
  std::uint64_t first = 0;
  std::uint64_t end = 0;
};

void cut(std::vector<Run>& from, const Run& what) {
  std::vector<Run> left;
  for (const Run& run : from) {
    if (run.first < what.first) left.push_back({run.first, std::min(run.end, what.first)});
    if (run.end > what.end) left.push_back({std::max(run.first, what.end), run.end});
  }
  from = std::move(left);
}

std::optional<DeviceNumbers> numbers_read(const ProtocolInfo& protocol, const Codec& codec,
                                          std::string_view range) {
  const auto span = codec.addresses().parse_range(range);
  if (!span) return std::nullopt;
  return numbers_of(protocol, *span);
}

/// What a machine with this codec understands by the range. Where its model is too small for all of
/// it, as a larger one with the same base understands it.
std::optional<DeviceNumbers> understood(const ProtocolInfo& protocol, const Codec& codec,
                                        std::string_view range) {
  if (auto numbers = numbers_read(protocol, codec, range)) return numbers;
  if (codec.plc() == nullptr) return std::nullopt;
  constexpr std::string_view tells_base = "Y10";
  const auto base = numbers_read(protocol, codec, tells_base);
  if (!base) return std::nullopt;
  for (const std::string_view model : protocol.models) {
    const auto larger = codec.plc()->with_model(model);
    if (larger == nullptr || numbers_read(protocol, *larger, tells_base) != base) continue;
    if (auto numbers = numbers_read(protocol, *larger, range)) return numbers;
  }
  return std::nullopt;
}

/// Takes away what the machine has and does not understand by the range. False where it has nothing
/// with these letters.
bool keep_understood(std::vector<Run>& runs, const DeviceNumbers& own, const ProtocolInfo& protocol,
                     const Codec& codec, std::string_view range) {
  const auto all = devices_lettered(protocol, codec, own.letters);
  const auto meant = understood(protocol, codec, range);
  for (const DeviceNumbers& has : all) {
    std::vector<Run> other = {{has.first, std::uint64_t{has.last} + 1}};
    if (meant && meant->letters == own.letters && meant->bits == own.bits && has.bits == own.bits)
      cut(other, {meant->first, std::uint64_t{meant->last} + 1});
    for (const Run& run : other) cut(runs, run);
  }
  return !all.empty();
}

/// The programming port knows no names, only addresses, and beyond the classic map they depend on
/// the model: what is sent for one lands elsewhere in another.
void cut_other_map(std::vector<Run>& runs, const Span& span, const DeviceConfig& device,
                   const Codec& other) {
  if (device.protocol->name != "fx-programming-port") return;
  const auto own_model = fx::model_named(model_of(*device.codec));
  if (!own_model) return;              // the PLC tells it
  if (other.plc() == nullptr) return;  // no PLC of ours at all
  const std::string name = model_of(other);
  const auto other_model = name.empty() ? fx::Model::unknown : fx::model_named(name);
  if (!other_model) return;  // no FX
  const auto space = static_cast<fx::Space>(span.space);
  const auto* own = fx::area_of(fx::map_of(*own_model, fx::CommandSet::extended), space);
  const auto* its = fx::area_of(fx::map_of(*other_model, fx::CommandSet::extended), space);
  if (own == nullptr) return;
  if (its != nullptr && its->address == own->address && its->force == own->force) return;
  const auto* classic = fx::area_of(fx::classic_map(), space);
  const auto set = device.options->find("command_set");
  const bool extended_alone =
      set != device.options->end() && set->second == OptionValue(std::string("extended"));
  const std::uint32_t by_classic = extended_alone || classic == nullptr ? 0 : classic->devices;
  cut(runs, {std::uint64_t{fx::kind_of(space).first_number} + by_classic, UINT64_MAX});
}

}  // namespace

NamedRanges::NamedRanges(const Config& local) : limits_(local.remote) {
  std::vector<const Codec*> seen;
  if (limits_.allow.empty()) return;
  for (const DeviceConfig& device : local.devices) {
    if (std::ranges::find(seen, device.codec.get()) != seen.end()) continue;
    seen.push_back(device.codec.get());
    add_readers(readers_, *device.protocol, device.codec);
  }
}

void NamedRanges::add_readers(std::vector<Reader>& readers, const ProtocolInfo& protocol,
                              const std::shared_ptr<const Codec>& codec) {
  if (!must_ask_model(*codec) || protocol.last_is_widest)
    return readers.push_back({&protocol, codec});
  for (const std::string_view model : protocol.models)
    if (auto one = codec->plc()->with_model(model)) readers.push_back({&protocol, std::move(one)});
}

std::vector<Span> NamedRanges::as_read(const DeviceConfig& device) const {
  const auto codec = widest_of(*device.protocol, device.codec);
  std::vector<Span> spans;
  for (const std::string& range : limits_.allow)
    if (const auto span = codec->addresses().parse_range(range)) spans.push_back(*span);
  return spans;
}

const std::vector<Span>& NamedRanges::for_new(const DeviceConfig& device) {
  const auto [place, is_new] = known_.try_emplace(device.codec.get());
  if (!is_new) return place->second;
  const auto codec = widest_of(*device.protocol, device.codec);
  for (const std::string& range : limits_.allow)
    std::ranges::move(shared(range, device, *codec), std::back_inserter(place->second));
  return place->second;
}

std::vector<Span> NamedRanges::shared(const std::string& range, const DeviceConfig& device,
                                      const Codec& codec) const {
  const auto span = codec.addresses().parse_range(range);
  if (!span) return {};
  const DeviceNumbers own = numbers_of(*device.protocol, *span);
  std::vector<Run> runs = {{own.first, std::uint64_t{own.last} + 1}};
  bool is_known = false;
  for (const Reader& reader : readers_) {
    is_known |= keep_understood(runs, own, *reader.protocol, *reader.codec, range);
    cut_other_map(runs, *span, device, *reader.codec);
  }
  if (!is_known) {
    std::vector<Reader> all;
    const ProtocolInfo& protocol = *device.protocol;
    Options options = default_options(protocol);
    if (protocol.models.empty())
      if (auto plain = protocol.make(options)) all.push_back({&protocol, *plain});
    for (const std::string_view model : protocol.models) {
      options["model"] = std::string(model);
      if (auto one = protocol.make(options); one && (*one)->addresses().parse_range(range))
        all.push_back({&protocol, *one});
    }
    for (const Reader& reader : all) keep_understood(runs, own, protocol, *reader.codec, range);
  }
  std::vector<Span> spans;
  spans.reserve(runs.size());
  for (const Run& run : runs)
    spans.push_back({span->space,
                     span->first_bit + static_cast<std::uint32_t>(run.first - own.first) * own.bits,
                     static_cast<std::uint32_t>(run.end - run.first) * own.bits});
  return spans;
}

}  // namespace fxagent
