#include "tests/agent/path/random_commands.h"

#include <array>
#include <bit>
#include <utility>

namespace fxagent::test {
namespace {

using Json = nlohmann::json;

constexpr unsigned kLastCharacters = 188;  // the printable ones of Latin-1 except the spaces

unsigned printable(unsigned number) { return (number % 2 == 0 ? 0x21 : 0xA1) + number / 2; }

}  // namespace

RandomCommands::RandomCommands(Fate& fate, std::vector<const LedgerDevice*> devices)
    : fate_(fate), devices_(std::move(devices)), next_once_(devices_.size()) {
  for (const LedgerDevice* device : devices_) places_.push_back(places_of(*device));
}

// ---- places and values --------------------------------------------------------------------------

RandomCommands::Json RandomCommands::name_of(std::uint32_t device, const Place& place) const {
  if (!place.tag.empty()) return {{"tag", place.tag}};
  constexpr std::array<const char*, 6> kTypes{"", "", "", "int32", "float32", "string"};
  const bool fx = devices_[device]->is_fx();
  const char* area = place.kind == Kind::bit ? (fx ? "M" : "co:") : (fx ? "D" : "hr:");
  Json name{{"address", area + std::to_string(place.number)}};
  const std::string type = kTypes[static_cast<std::size_t>(place.kind)];
  if (!type.empty()) name["type"] = type;
  return name;
}

/// Returns a place in commands.allow without a tag; as small as its kind allows.
Place RandomCommands::raw_place() {
  switch (fate_.between(0, 7)) {
    case 0:
      return {"", Kind::dword, static_cast<unsigned>(1300 + 2 * fate_.between(0, 9))};
    case 1:
      return {"", Kind::real, static_cast<unsigned>(1400 + 2 * fate_.between(0, 9))};
    case 2:
      return {"", Kind::text, 1500, 0, 8};
    case 3:
      return kOddText;
    case 4:
      return {"", Kind::bit, static_cast<unsigned>(fate_.between(100, 140))};
    default:
      return {"", Kind::word, static_cast<unsigned>(fate_.between(1000, 1049))};
  }
}

std::uint32_t RandomCommands::fresh_long() {
  const std::uint32_t high = fresh();
  return (high << 16U) + fresh();
}

/// Two characters encode a number; if the length is odd, the last character encodes another.
std::string RandomCommands::fresh_text(std::uint32_t device, unsigned length, bool next_odd) {
  std::string text;
  for (unsigned i = 0; i < length / 2; ++i) {
    const unsigned number = fresh();
    text += utf8('0' + number % 64U);
    text += utf8('0' + number / 64U % 64U);
  }
  unsigned& last = next_once_[device].last_character;
  if (length % 2 != 0) text += utf8(printable(next_odd ? ++last : last));
  return text;
}

/// Returns a bit that is not `on` and that no other command sets. A bit that already has the value
/// would read back correctly even if it was never set.
unsigned RandomCommands::next_bit(std::uint32_t device, bool on) {
  unsigned& next = on ? next_once_[device].on : next_once_[device].off;
  do {
    ++next;
  } while ((next % 3 == 0) == on);
  return next;
}

// ---- targets ------------------------------------------------------------------------------------

RandomCommands::Target RandomCommands::made_of(std::uint32_t device, const Place& place,
                                               Json value) const {
  Target made;
  made.json = name_of(device, place);
  made.wanted = {place, *elements_of(place, value, *devices_[device])};
  made.json["value"] = std::move(value);
  return made;
}

RandomCommands::Target RandomCommands::word_target(std::uint32_t device) {
  if (!fate_.one_in(4)) return made_of(device, any_of(device, "w", 8), fresh());
  const auto number = static_cast<unsigned>(fate_.between(1000, 1049));
  return made_of(device, {"", Kind::word, number}, fresh());
}

RandomCommands::Target RandomCommands::tenths_target(std::uint32_t device) {
  return made_of(device, tag(device, "sc"), fresh() / 10.0);
}

RandomCommands::Target RandomCommands::array_target(std::uint32_t device) {
  Place place = any_of(device, "a", 2);
  if (fate_.one_in(4)) place = {"", Kind::word, 1100, static_cast<unsigned>(fate_.between(2, 90))};
  Json values = Json::array();
  for (unsigned i = 0; i < place.count; ++i) values.push_back(fresh());
  return made_of(device, place, std::move(values));
}

RandomCommands::Target RandomCommands::long_target(std::uint32_t device) {
  if (fate_.one_in(3)) {
    const Place& place = tag(device, "la");
    Json values = Json::array();
    for (unsigned i = 0; i < place.count; ++i) values.push_back(fresh_long());
    return made_of(device, place, std::move(values));
  }
  if (fate_.one_in(4)) return made_of(device, {"", Kind::dword, 1300}, fresh_long());
  return made_of(device, any_of(device, "l", 4), fresh_long());
}

RandomCommands::Target RandomCommands::float_target(std::uint32_t device) {
  std::uint32_t bits = (0x4000U + fresh() % 0x3000U) << 16U;
  bits += fresh();
  const Place raw{"", Kind::real, 1400};
  return made_of(device, fate_.one_in(4) ? raw : tag(device, "f0"),
                 widened(std::bit_cast<float>(bits)));
}

RandomCommands::Target RandomCommands::text_target(std::uint32_t device) {
  constexpr std::array<const char*, 7> kTags{"s0", "s1", "s2", "s3", "s3", "s3", "sa"};
  const int which = fate_.between(0, 8);
  Place place{"", Kind::text, 1500, 0, 8};
  if (which == 8) place = kOddText;
  if (which < 7) place = tag(device, kTags[static_cast<std::size_t>(which)]);
  if (place.length % 2 != 0 && next_once_[device].last_character + 1 >= kLastCharacters)
    return word_target(device);
  if (place.count == 0) return made_of(device, place, fresh_text(device, place.length, true));
  Json values = Json::array();
  for (unsigned i = 0; i < place.count; ++i)
    values.push_back(fresh_text(device, place.length, /*next_odd=*/i == 0));
  return made_of(device, place, std::move(values));
}

RandomCommands::Target RandomCommands::limited_target(std::uint32_t device) {
  Once& once = next_once_[device];
  if (once.limited > kLastLimited) return word_target(device);
  const unsigned number = once.limited++;
  // The raw values nearest to the limits lie inside and outside of them.
  constexpr std::array<double, 8> kValues{0.36, 0.5, 50.04, 99.94, 0.34, 0.349, 99.955, 99.97};
  constexpr std::array<double, 8> kRounded{0.4, 0.5, 50.0, 99.9, 0.3, 0.3, 100.0, 100.0};
  const auto i = static_cast<std::size_t>(fate_.between(0, 7));
  Target made = made_of(device, tag(device, "lim" + std::to_string(number)), kRounded[i]);
  made.json["value"] = kValues[i];
  return made;
}

RandomCommands::Target RandomCommands::bit_target(std::uint32_t device) {
  Once& once = next_once_[device];
  if (!once.flags && fate_.one_in(4)) {
    once.flags = true;
    const Place& place = tag(device, "flags");
    Json values = shown(place, *devices_[device]);
    for (Json& each : values) each = !each.get<bool>();
    return made_of(device, place, std::move(values));
  }
  return force_target(device, fate_.one_in(2));
}

RandomCommands::Target RandomCommands::force_target(std::uint32_t device, bool on) {
  unsigned& flag = next_once_[device].flag;
  if (flag < 10 && devices_[device]->bit(flag) != on && fate_.one_in(3))
    return made_of(device, tag(device, "t" + std::to_string(flag++)), on);
  return made_of(device, {"", Kind::bit, next_bit(device, on)}, on);
}

RandomCommands::Target RandomCommands::target(std::uint32_t device) {
  // A scene has a limited number of distinct values.
  const bool room = fresh_ < 25000;
  switch (fate_.between(0, 14)) {
    case 0:
    case 7:
      return room ? array_target(device) : word_target(device);
    case 1:
      return room ? long_target(device) : word_target(device);
    case 2:
      return float_target(device);
    case 3:
    case 8:
      // Two characters distinguish only this many numbers.
      return fresh_ < 3900 ? text_target(device) : word_target(device);
    case 4:
      return limited_target(device);
    case 5:
    case 6:
      return bit_target(device);
    case 9:
      return tenths_target(device);
    default:
      return word_target(device);
  }
}

// ---- commands -----------------------------------------------------------------------------------

void RandomCommands::write(SentCommand& sent, Json& command) {
  if (!fate_.one_in(3)) {
    Target one = target(sent.device);
    command.update(one.json);
    sent.targets.push_back(std::move(one.wanted));
    return;
  }
  sent.is_list = true;
  command["targets"] = Json::array();
  const bool words_only = fate_.one_in(2);
  for (int i = fate_.between(1, 6); i > 0; --i) {
    Target one = words_only ? word_target(sent.device) : target(sent.device);
    command["targets"].push_back(std::move(one.json));
    sent.targets.push_back(std::move(one.wanted));
  }
}

void RandomCommands::force(SentCommand& sent, Json& command) {
  const bool on = fate_.one_in(2);
  sent.op = command["op"] = on ? "force_on" : "force_off";
  sent.is_list = fate_.one_in(2);
  if (sent.is_list) command["targets"] = Json::array();
  for (int i = sent.is_list ? fate_.between(1, 8) : 1; i > 0; --i) {
    Target one = force_target(sent.device, on);
    one.json.erase("value");
    if (sent.is_list)
      command["targets"].push_back(std::move(one.json));
    else
      command.update(one.json);
    sent.targets.push_back(std::move(one.wanted));
  }
}

void RandomCommands::read(SentCommand& sent, Json& command) {
  const std::vector<Place>& tags = places_[sent.device];
  Place place = tags[static_cast<std::size_t>(fate_.between(0, static_cast<int>(tags.size()) - 1))];
  if (fate_.one_in(20)) place = {"ro", Kind::word, 990};
  if (fate_.one_in(3)) {
    place = raw_place();
    if (place.kind == Kind::text)
      place.length = static_cast<unsigned>(fate_.between(1, 250));
    else if (fate_.one_in(2))
      place.count = static_cast<unsigned>(fate_.between(2, 125));
  }
  command.update(name_of(sent.device, place));
  if (place.tag.empty() && place.kind == Kind::text) command["length"] = place.length;
  if (place.tag.empty() && place.count > 0) command["count"] = place.count;
  sent.read = std::move(place);
}

void RandomCommands::switch_plc(SentCommand& sent, Json& command) {
  Once& once = next_once_[sent.device];
  bool& used = sent.op == "run" ? once.run : once.stop;
  if (used) {  // one of each per scene, so that its effect is attributable
    sent.op = command["op"] = "read";
    return read(sent, command);
  }
  used = true;
  if (!devices_[sent.device]->is_fx()) sent.is_wrong = true;
}

void RandomCommands::add_conditions(SentCommand& sent, Json& command, std::int64_t utc_ms) {
  const bool writes = !sent.targets.empty();
  if (fate_.one_in(3))
    command["expires"] = utc_ms + fate_.between(-20, fate_.one_in(2) ? 300 : 2500);
  if (writes && fate_.one_in(2)) command["verify"] = fate_.one_in(2);
  if (fate_.one_in(20)) sent.message_expiry_s = fate_.between(0, 2);
  if (fate_.one_in(25)) sent.dry_run = command["dry_run"] = true;
  if (fate_.one_in(4)) command["by"] = "anna";
  if (writes && !sent.is_list && fate_.one_in(4)) add_expect(sent, command);
}

RandomCommands::Json RandomCommands::another(const Place& place, Json value) {
  if (value.is_array()) {
    Json& one =
        value[static_cast<std::size_t>(fate_.between(0, static_cast<int>(place.count) - 1))];
    one = another(place, one);
    return value;
  }
  if (place.kind == Kind::bit) return !value.get<bool>();
  if (place.kind == Kind::text) {
    const auto text = value.get<std::string>();
    return fate_.one_in(2) ? text + "+" : text.substr(0, text.find_first_of("0123456789AB"));
  }
  const auto number = value.get<double>();
  // No device can hold 2^60; a hundredth of a tenth and half of a whole are never shown.
  constexpr std::array<double, 4> kApart{1, -1, 0.01, 1152921504606846976.0};
  return number + kApart[static_cast<std::size_t>(fate_.between(0, 3))];
}

void RandomCommands::add_expect(SentCommand& sent, Json& command) {
  const Place& place = sent.targets[0].place;
  Json expect = shown(place, *devices_[sent.device]);
  if (fate_.one_in(4)) expect = another(place, std::move(expect));
  if (expect == 0 && fate_.one_in(2)) expect = -0.0;
  sent.expect = expect;
  command["expect"] = std::move(expect);
}

void RandomCommands::spoil(SentCommand& sent, Json& command) {
  sent.is_wrong = true;
  sent.targets.clear();
  sent.is_list = false;
  sent.read.reset();
  sent.expect.reset();
  for (const char* key :
       {"tag", "address", "type", "value", "targets", "expect", "count", "length", "verify"})
    command.erase(key);
  command["op"] = sent.op = "write";
  command["value"] = fresh();
  const Json right{{"tag", "w0"}, {"value", fresh()}};
  const auto w1_with = [](const char* key, Json value) {
    return Json{{"tag", "w1"}, {key, std::move(value)}};
  };
  const Json faults = Json::array({
      {{"tag", "nothing"}},
      name_of(sent.device, {"", Kind::word, 100}),  // a tag, not in allow
      {{"tag", "ro"}},
      w1_with("value", 70000),
      w1_with("value", "eleven"),
      {{"tag", "lim980"}, {"value", 200.0}},
      w1_with("valeu", 4),
      w1_with("op", "reset"),
      w1_with("status", "SUCCEEDED"),
      w1_with("expect", nullptr),
      w1_with("count", 2),
      {{"tag", "t0"}, {"op", "force_on"}},
      w1_with("op", "stop"),
      {{"tag", "s2"}, {"value", "nine char"}},
      {{"tag", "w1"}},  // retained
      // Without `value` in the command itself:
      {{"tag", "w1"}},
      {{"targets", Json::array({right, {{"tag", "nothing"}, {"value", 1}}, right})}},
      {{"targets", Json::array_t(65, right)}},
  });
  const int fault = fate_.between(0, 17);
  if (fault >= 15) command.erase("value");
  command.update(faults[static_cast<std::size_t>(fault)]);
  if (command["op"] == "reset") sent.op = "reset";
  sent.retained = fault == 14;
}

void RandomCommands::make_unreadable(SentCommand& sent) {
  const Json whole{{"id", "lost"}, {"op", "write"}, {"tag", "w0"}, {"value", fresh()}};
  Json without = whole;
  without.erase("id");
  const std::array<std::string, 6> kPayloads{whole.dump().substr(0, 40), without.dump(),
                                             "\xff\xfe{\"id\"",          "[" + whole.dump() + "]",
                                             std::string(70000, 'x'),    "7"};
  sent.payload = kPayloads[static_cast<std::size_t>(fate_.between(0, 5))];
  sent.is_wrong = true;
}

SentCommand RandomCommands::next(std::int64_t utc_ms) {
  SentCommand sent;
  sent.device = static_cast<std::uint32_t>(fate_.between(0, kPathDevices - 1));
  if (fate_.one_in(30)) {
    make_unreadable(sent);
    return sent;
  }
  sent.id = "c" + std::to_string(++next_id_);
  constexpr std::array<const char*, 12> kOps{"write",    "write",     "write", "write",
                                             "write",    "write",     "write", "read",
                                             "force_on", "force_off", "run",   "stop"};
  sent.op = kOps[static_cast<std::size_t>(fate_.between(0, 11))];
  Json command{{"id", sent.id}, {"op", sent.op}};
  if (sent.op == "write")
    write(sent, command);
  else if (sent.op == "read")
    read(sent, command);
  else if (sent.op == "run" || sent.op == "stop")
    switch_plc(sent, command);
  else
    force(sent, command);
  add_conditions(sent, command, utc_ms);
  if (fate_.one_in(12)) spoil(sent, command);
  if (fate_.one_in(6)) {
    command["id"] = next_id_;
    sent.id = std::to_string(next_id_);
  }
  sent.payload = command.dump();
  return sent;
}

}  // namespace fxagent::test
