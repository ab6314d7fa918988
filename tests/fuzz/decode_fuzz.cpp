// Feeds arbitrary bytes from a wire to every codec of the catalogue: as the answer to each kind of
// request, and to be explained. Nothing may crash, and every accepted value must lie within the
// input.
#include <cstdint>
#include <cstdlib>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "protocol/catalog.h"
#include "protocol/codec.h"

namespace {

using namespace fxagent;

/// Returns the values to try for the option. For a station or a time, frames differ only in digits.
std::vector<OptionValue> values_of(const OptionSpec& option) {
  std::vector<OptionValue> values;
  switch (option.kind) {
    case OptionSpec::Kind::boolean:
      return {true, false};
    case OptionSpec::Kind::choice:
      for (const std::string_view choice : option.choices) values.emplace_back(std::string(choice));
      return values;
    case OptionSpec::Kind::integer:
      break;
  }
  if (option.max - option.min > 8) return {};
  for (std::int64_t value = option.min; value <= option.max; ++value) values.emplace_back(value);
  return values;
}

/// Returns the default options with a known model, and variants with one option changed.
std::vector<Options> variants(const ProtocolInfo& protocol) {
  const Options base = [&] {
    Options options = default_options(protocol);
    if (!protocol.models.empty()) options["model"] = std::string(protocol.models.back());
    return options;
  }();
  std::vector<Options> list{base};
  const auto add = [&](std::string_view key, OptionValue value) {
    list.push_back(base);
    list.back().find(key)->second = std::move(value);
  };
  for (const OptionSpec& option : protocol.options)
    for (OptionValue& value : values_of(option))
      if (base.contains(option.key)) add(option.key, std::move(value));
  if (!protocol.models.empty()) add("model", std::string(protocol.models.front()));
  return list;
}

/// Returns the codec's requests in all their forms. Other memory would only change the addresses.
std::vector<Request> questions(const Codec& codec) {
  std::vector<Request> asked = {Enquire{}};
  std::set<std::tuple<std::uint8_t, std::uint8_t, std::uint32_t>> shapes;
  std::map<std::uint8_t, Gather> gathers;
  std::vector<Request> writes;
  for (std::uint16_t space = 0; space < 64; ++space) {
    for (const ReadWay& way : codec.addresses().read_ways(space)) {
      if (!shapes.emplace(way.way, way.gather, way.unit_bits).second) continue;
      const std::uint32_t bits = way.unit_bits;
      const Span span{space, way.first_bit, bits};
      if (way.gather != 0) {
        gathers[way.gather].parts.push_back({span, way.way, way.gather});
        continue;
      }
      asked.emplace_back(Read{span, way.way});
      asked.emplace_back(Read{{space, way.first_bit, 3 * bits}, way.way});
      writes.emplace_back(Force{space, way.first_bit, true});
      writes.emplace_back(Write{span, Bytes((bits + 7) / 8, 0x5A)});
    }
  }
  for (auto& [command, gather] : gathers) {
    asked.emplace_back(gather);
    gather.parts.resize(1, gather.parts.front());
    asked.emplace_back(gather);
  }
  asked.insert(asked.end(), writes.begin(), writes.end());
  for (std::size_t i = 0; i < writes.size(); ++i)
    if (const auto together = codec.combine({writes[i], writes[(i + 2) % writes.size()]}))
      asked.push_back(*together);
  for (const auto kind : {Control::Kind::identify, Control::Kind::run, Control::Kind::stop})
    asked.emplace_back(Control{kind});
  std::erase_if(asked, [&](const Request& request) { return !codec.encode(request, 1); });
  return asked;
}

struct Asker {
  std::shared_ptr<const Codec> codec;
  std::vector<Request> questions;
};

/// Returns every distinct codec of the catalogue: many options do not affect the frames.
std::vector<Asker> every_asker() {
  std::vector<Asker> askers;
  for (const ProtocolInfo& protocol : catalog()) {
    std::set<Bytes> seen;
    for (const Options& options : variants(protocol)) {
      auto codec = protocol.make(options);
      if (!codec) continue;  // an invalid combination of options
      Asker asker{*codec, questions(**codec)};
      Bytes frames;
      for (const Request& request : asker.questions) {
        const Bytes frame = *asker.codec->encode(request, 1);
        frames.insert(frames.end(), frame.begin(), frame.end());
      }
      if (seen.insert(std::move(frames)).second) askers.push_back(std::move(asker));
    }
    if (seen.empty()) std::abort();
  }
  return askers;
}

/// Returns the size of a read's image in bytes; nullopt if the request is not a read.
std::optional<std::size_t> image_size(const Request& request) {
  const auto bytes = [](const Read& read) { return std::size_t{read.span.bits + 7} / 8; };
  if (const auto* read = std::get_if<Read>(&request)) return bytes(*read);
  const auto* gather = std::get_if<Gather>(&request);
  if (gather == nullptr) return std::nullopt;
  std::size_t size = 0;
  for (const Read& part : gather->parts) size += bytes(part);
  return size;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const auto askers = every_asker();
  const ByteView rx(data, size);
  for (const Asker& asker : askers) {
    for (const Request& request : asker.questions) {
      const auto reply = asker.codec->decode(request, 1, rx);
      if (!reply || !*reply) continue;
      if ((*reply)->consumed > size) std::abort();
      const auto wanted = image_size(request);
      const bool has_data = (*reply)->kind == Reply::Kind::data;
      if (wanted && has_data && (*reply)->image.size() != *wanted) std::abort();
    }
    asker.codec->explain(rx, std::nullopt);
    asker.codec->explain(rx, Direction::request);
    asker.codec->explain(rx, Direction::reply);
  }
  return 0;
}
