// Any bytes from a wire, given to every codec of the catalogue: as the answer to each kind of
// question it can ask, and to be explained. Nothing may crash, and what is accepted must lie inside
// what came.
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "protocol/catalog.h"
#include "protocol/codec.h"

namespace {

using namespace fxagent;

/// The options with one changed of those that change the frames.
std::vector<Options> variants(const ProtocolInfo& protocol, const Options& options) {
  std::vector<std::pair<std::string, OptionValue>> changes{
      {"format", std::int64_t{4}},
      {"sum_check", false},
      {"command_set", std::string("classic")},
      {"command_set", std::string("extended")}};
  if (!protocol.models.empty()) changes.emplace_back("model", std::string(protocol.models.front()));
  std::vector<Options> list;
  for (const auto& [key, value] : changes) {
    if (!options.contains(key)) continue;
    list.push_back(options);
    list.back()[key] = value;
  }
  return list;
}

std::vector<std::shared_ptr<const Codec>> every_codec() {
  std::vector<std::shared_ptr<const Codec>> codecs;
  for (const ProtocolInfo& protocol : catalog()) {
    Options options = default_options(protocol);
    if (!protocol.models.empty()) options["model"] = std::string(protocol.models.back());
    auto codec = protocol.make(options);
    if (!codec) std::abort();
    codecs.push_back(*codec);
    for (const Options& other : variants(protocol, options)) {
      auto variant = protocol.make(other);
      if (!variant) std::abort();
      codecs.push_back(*variant);
    }
  }
  return codecs;
}

/// One request of each kind that the codec can say.
std::vector<Request> questions(const Codec& codec) {
  std::vector<Request> asked = {Enquire{}};
  for (std::uint16_t space = 0; space < 32; ++space) {
    for (const ReadWay& way : codec.addresses().read_ways(space)) {
      const std::uint32_t bits = way.unit_bits;
      const Span span{space, way.first_bit, bits};
      asked.emplace_back(Read{span, way.way});
      asked.emplace_back(Force{space, way.first_bit, true});
      asked.emplace_back(Write{span, Bytes((bits + 7) / 8, 0x5A)});
    }
  }
  for (const auto kind : {Control::Kind::identify, Control::Kind::run, Control::Kind::stop})
    asked.emplace_back(Control{kind});
  return asked;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const auto codecs = every_codec();
  const ByteView rx(data, size);
  for (const auto& codec : codecs) {
    static std::vector<std::vector<Request>> asked;
    if (asked.size() < codecs.size())
      for (const auto& each : codecs) asked.push_back(questions(*each));
    for (const Request& request : asked[static_cast<std::size_t>(&codec - codecs.data())]) {
      if (!codec->encode(request, 1)) continue;
      const auto reply = codec->decode(request, 1, rx);
      if (!reply || !*reply) continue;
      if ((*reply)->consumed > size) std::abort();
      const auto* read = std::get_if<Read>(&request);
      const bool has_data = (*reply)->kind == Reply::Kind::data;
      if (read != nullptr && has_data && (*reply)->image.size() != (read->span.bits + 7) / 8)
        std::abort();
    }
    codec->explain(rx, std::nullopt);
    codec->explain(rx, Direction::request);
    codec->explain(rx, Direction::reply);
  }
  return 0;
}
