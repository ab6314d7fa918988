#include "tests/agent/path/plant.h"

#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <utility>

namespace fxagent::test {
namespace {

using Json = nlohmann::json;

constexpr std::array<const char*, kPathDevices> kNames{"press", "oven", "meter", "drive"};
constexpr unsigned kArrayOfFx = 70;       // three frames of the port, two of the link
constexpr unsigned kArrayOfModbus = 200;  // two frames

std::vector<Place> places(bool fx) {
  const unsigned array = fx ? kArrayOfFx : kArrayOfModbus;
  std::vector<Place> all;
  for (unsigned i = 0; i < 8; ++i) all.push_back({"w" + std::to_string(i), Kind::word, 100 + i});
  all.push_back({"sc", Kind::tenths, 110});
  all.push_back({"a0", Kind::word, 200, array});
  all.push_back({"a1", Kind::word, 500, array});
  for (unsigned i = 0; i < 4; ++i)
    all.push_back({"l" + std::to_string(i), Kind::dword, 800 + 2 * i});
  all.push_back({"la", Kind::dword, 820, 40});
  all.push_back({"f0", Kind::real, 900});
  all.push_back({"s0", Kind::text, 910, 0, 8});
  all.push_back({"s1", Kind::text, 920, 0, 100});
  for (unsigned i = kFirstLimited; i <= kLastLimited; ++i)
    all.push_back({"lim" + std::to_string(i), Kind::tenths, i});
  all.push_back({"s2", Kind::text, 2000, 0, 7});
  all.push_back({"s3", Kind::text, 2010, 0, fx ? 151U : 271U});  // needs several frames
  all.push_back({"sa", Kind::text, 2200, 40, 3});
  for (unsigned i = 0; i < 10; ++i) all.push_back({"t" + std::to_string(i), Kind::bit, i});
  all.push_back({"flags", Kind::bit, 16, 16});  // in bytes that hold nothing else
  return all;
}

const char* type_of(Kind kind) {
  constexpr std::array<const char*, 6> kTypes{"bool",  "int16",   "int16",
                                              "int32", "float32", "string"};
  return kTypes[static_cast<std::size_t>(kind)];
}

Json tags(bool fx) {
  Json all = Json::array();
  for (const Place& place : places(fx)) {
    const std::string area = place.kind == Kind::bit ? (fx ? "M" : "co:") : (fx ? "D" : "hr:");
    Json tag{{"name", place.tag},
             {"address", area + std::to_string(place.number)},
             {"type", type_of(place.kind)},
             {"access", "read_write"}};
    if (place.count > 0) tag["count"] = place.count;
    if (place.length > 0) tag["length"] = place.length;
    if (place.kind == Kind::tenths) tag["scale"] = 0.1;
    if (place.number >= kFirstLimited && place.number <= kLastLimited)
      tag.update({{"min", 0.34}, {"max", 99.97}});
    all.push_back(std::move(tag));
  }
  all.push_back({{"name", "ro"}, {"address", fx ? "D990" : "hr:990"}, {"type", "int16"}});
  return all;
}

Json device(const char* name, const char* protocol, bool fx) {
  const Json allow = fx ? Json{"M100-M999", "D1000-D1999"} : Json{"co:100-999", "hr:1000-1999"};
  Json made{{"name", name},
            {"link", name},
            {"protocol", protocol},
            {"timeout_ms", 200},
            {"retries", 1},
            {"tags", tags(fx)},
            {"commands", {{"allow", allow}, {"allow_run_stop", true}, {"queue", 6}}}};
  if (fx) made["model"] = "FX3U";
  return made;
}

// ---- values in words --------------------------------------------------------------------------

/// The lowest bit of character `i` of a text within its word.
unsigned shift_of(std::size_t i, const LedgerDevice& device) {
  return (i % 2 != 0) == device.is_fx() ? 8 : 0;
}

unsigned words_of(const Place& place) {
  if (place.kind == Kind::text) return (place.length + 1) / 2;
  return place.kind == Kind::dword || place.kind == Kind::real ? 2 : 1;
}

std::optional<std::string> latin1(const std::string& text) {
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto lead = static_cast<unsigned char>(text[i]);
    if (lead < 0x80) {
      out += text[i];
      continue;
    }
    if (lead > 0xC3 || ++i == text.size()) return std::nullopt;
    out += static_cast<char>((lead & 3U) << 6U | (static_cast<unsigned char>(text[i]) & 0x3FU));
  }
  return out;
}

/// Returns the characters of a text and, if there is room, its terminator.
std::optional<std::vector<Part>> text_parts(const Place& place, unsigned number, const Json& value,
                                            const LedgerDevice& device) {
  if (!value.is_string()) return std::nullopt;
  auto text = latin1(value.get<std::string>());
  if (!text || text->size() > place.length) return std::nullopt;
  if (text->size() < place.length) *text += '\0';
  std::vector<Part> out((text->size() + 1) / 2);
  for (std::size_t i = 0; i < out.size(); ++i)
    out[i] = {{false, number + static_cast<unsigned>(i), 0}, 0};
  for (std::size_t i = 0; i < text->size(); ++i) {
    const unsigned shift = shift_of(i, device);
    out[i / 2].deed.value |= std::uint32_t{static_cast<unsigned char>((*text)[i])} << shift;
    out[i / 2].mask |= 0xFFU << shift;
  }
  return out;
}

std::vector<Part> long_parts(unsigned number, std::uint32_t value, const LedgerDevice& device) {
  const unsigned low = device.is_fx() ? 0 : 1;  // position of the low word
  return {{{false, number + low, value & 0xFFFFU}}, {{false, number + 1 - low, value >> 16U}}};
}

std::optional<std::vector<Part>> element(const Place& place, unsigned number, const Json& value,
                                         const LedgerDevice& device) {
  if (place.kind == Kind::text) return text_parts(place, number, value, device);
  if (place.kind == Kind::bit) {
    if (!value.is_boolean()) return std::nullopt;
    return std::vector<Part>{{{true, number, value.get<bool>() ? 1U : 0U}}};
  }
  if (!value.is_number()) return std::nullopt;
  const auto x = value.get<double>();
  if (place.kind == Kind::real) {
    const auto number32 = static_cast<float>(x);
    if (widened(number32) != x) return std::nullopt;
    return long_parts(number, x == 0 ? 0 : std::bit_cast<std::uint32_t>(number32), device);
  }
  const double raw = place.kind == Kind::tenths ? std::round(x * 10) : std::floor(x);
  if ((place.kind == Kind::tenths ? raw / 10 : raw) != x) return std::nullopt;
  const auto bits = static_cast<std::uint32_t>(static_cast<std::int64_t>(raw));
  if (place.kind == Kind::dword) return long_parts(number, bits, device);
  return std::vector<Part>{{{false, number, bits & 0xFFFFU}}};
}

Json shown_element(const Place& place, unsigned number, const LedgerDevice& device) {
  if (place.kind == Kind::bit) return device.bit(number);
  if (place.kind == Kind::text) {
    std::string text;
    for (std::size_t i = 0; i < place.length; ++i) {
      const std::uint32_t word = device.word(number + static_cast<unsigned>(i / 2));
      const unsigned character = (word >> shift_of(i, device)) & 0xFFU;
      if (character == 0) break;
      text += utf8(character);
    }
    return text;
  }
  const auto word = static_cast<std::int16_t>(device.word(number));
  if (place.kind == Kind::word) return word;
  if (place.kind == Kind::tenths) return word / 10.0;
  const unsigned low = device.is_fx() ? 0 : 1;
  const std::uint32_t value = device.word(number + low) | device.word(number + 1 - low) << 16U;
  if (place.kind == Kind::dword) return static_cast<std::int32_t>(value);
  return widened(std::bit_cast<float>(value));
}

}  // namespace

// ---- the plant ----------------------------------------------------------------------------------

std::string plant_of_the_path() {
  constexpr std::array<const char*, kPathDevices> kProtocolNames{
      "fx-programming-port", "fx-computer-link", "modbus-tcp", "modbus-rtu"};
  Json links = Json::array();
  Json devices = Json::array();
  for (std::size_t i = 0; i < kNames.size(); ++i) {
    Json link{{"name", kNames[i]}, {"tcp", {{"host", "192.0.2.1"}, {"port", 4000 + i}}}};
    if (i != 2) link["line_baud"] = 19200;
    links.push_back(std::move(link));
    devices.push_back(device(kNames[i], kProtocolNames[i], i < 2));
  }
  return Json{{"agent", {{"id", "edge7"}, {"root", "fx/path"}}},
              {"mqtt", {{"servers", {"mqtt://127.0.0.1:1883"}}}},
              {"links", std::move(links)},
              {"devices", std::move(devices)}}
      .dump(1);
}

std::vector<Place> places_of(const LedgerDevice& device) { return places(device.is_fx()); }

const Place& place_of(const std::vector<Place>& places, std::string_view tag) {
  return *std::find_if(places.begin(), places.end(),
                       [tag](const Place& each) { return each.tag == tag; });
}

void prepare(LedgerDevice& device, Fate& fate) {
  std::vector<Place> texts = places_of(device);
  std::erase_if(texts, [](const Place& each) { return each.kind != Kind::text; });
  texts.push_back(kOddText);
  for (const Place& text : texts) {
    const unsigned words = words_of(text);
    for (unsigned i = 0; i < words * std::max(1U, text.count); ++i)
      device.preset_word(text.number + i, static_cast<std::uint32_t>(fate.between(1, 0xFFFF)));
    // The text ends before its place does.
    const auto end = static_cast<unsigned>(fate.between(0, static_cast<int>(text.length) / 2));
    device.preset_word(text.number + end, fate.one_in(2) ? 0x0041U : 0x4100U);
    if (text.length % 2 == 0) continue;
    for (unsigned i = 1; i <= std::max(1U, text.count); ++i)
      device.share(text.number + i * words - 1, 0xFFU << shift_of(text.length, device));
  }
}

// ---- values -------------------------------------------------------------------------------------

std::optional<Elements> elements_of(const Place& place, const Json& value,
                                    const LedgerDevice& device) {
  Elements out;
  if (place.count > 0) {
    if (!value.is_array() || value.size() != place.count) return std::nullopt;
    unsigned number = place.number;
    for (const Json& each : value) {
      auto parts = element(place, number, each, device);
      if (!parts) return std::nullopt;
      out.push_back(*std::move(parts));
      number += words_of(place);
    }
    return out;
  }
  const auto parts = element(place, place.number, value, device);
  if (!parts) return std::nullopt;
  if (place.kind == Kind::text)
    for (const Part& part : *parts) out.push_back({part});
  else
    out.push_back(*parts);
  return out;
}

Json shown(const Place& place, const LedgerDevice& device) {
  if (place.count == 0) return shown_element(place, place.number, device);
  Json out = Json::array();
  for (unsigned i = 0; i < place.count; ++i)
    out.push_back(shown_element(place, place.number + i * words_of(place), device));
  return out;
}

bool was_shown(const Place& place, const Json& value, const LedgerDevice& device, TimeSpan when) {
  const auto elements = elements_of(place, value, device);
  if (!elements) return false;
  for (const std::vector<Part>& parts : *elements)
    for (const Part& part : parts)
      if (!device.was(part.deed, part.mask, when)) return false;
  return true;
}

double widened(float number) {
  std::array<char, 32> text{};
  const auto end = std::to_chars(text.data(), text.data() + text.size(), number).ptr;
  double wide = 0;
  std::from_chars(text.data(), end, wide);
  return wide;
}

std::string utf8(unsigned character) {
  if (character < 0x80) return std::string(1, static_cast<char>(character));
  return {static_cast<char>(0xC0U | character >> 6U),
          static_cast<char>(0x80U | (character & 0x3FU))};
}

}  // namespace fxagent::test
