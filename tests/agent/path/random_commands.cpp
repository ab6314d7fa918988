#include "tests/agent/path/random_commands.h"

#include <array>
#include <bit>
#include <utility>

namespace fxagent::test {
namespace {

using Json = nlohmann::json;

constexpr std::array<const char*, kPathDevices> kNames{"press", "oven", "meter", "drive"};
constexpr unsigned kArrayOfFx = 70;       // three frames of the port, two of the link
constexpr unsigned kArrayOfModbus = 200;  // two frames
constexpr unsigned kLongs = 40;
constexpr unsigned kFlags = 16;
constexpr unsigned kFirstFlag = 16;  // on a byte of its own

Json tag(const char* name, const std::string& address) {
  return {{"name", name}, {"address", address}, {"access", "read_write"}};
}
Json tag(const char* name, const std::string& address, const char* type, Json more = {}) {
  Json made = tag(name, address);
  made["type"] = type;
  if (more.is_object()) made.update(more);
  return made;
}

Json tags(const std::string& word, const std::string& bit, unsigned array) {
  const auto at = [&](unsigned number) { return word + std::to_string(number); };
  const auto flag = [&](unsigned number) { return bit + std::to_string(number); };
  Json all = Json::array();
  for (unsigned i = 0; i < 8; ++i)
    all.push_back(tag(("w" + std::to_string(i)).c_str(), at(100 + i), "int16"));
  all.push_back(tag("a0", at(200), "int16", {{"count", array}}));
  all.push_back(tag("a1", at(500), "int16", {{"count", array}}));
  for (unsigned i = 0; i < 4; ++i)
    all.push_back(tag(("l" + std::to_string(i)).c_str(), at(800 + 2 * i), "int32"));
  all.push_back(tag("la", at(820), "int32", {{"count", kLongs}}));
  all.push_back(tag("f0", at(900), "float32"));
  all.push_back(tag("s0", at(910), "string", {{"length", 8}}));
  all.push_back(tag("s1", at(920), "string", {{"length", 100}}));
  for (unsigned i = kFirstLimited; i <= kLastLimited; ++i)
    all.push_back(tag(("lim" + std::to_string(i)).c_str(), at(i), "int16",
                      {{"scale", 0.1}, {"min", 0.34}, {"max", 99.97}}));
  all.push_back({{"name", "ro"}, {"address", at(990)}, {"type", "int16"}});
  for (unsigned i = 0; i < 10; ++i)
    all.push_back(tag(("t" + std::to_string(i)).c_str(), flag(i), "bool"));
  all.push_back(tag("flags", flag(kFirstFlag), "bool", {{"count", kFlags}}));
  return all;
}

Json device(const char* name, const char* protocol, bool fx) {
  const std::string word = fx ? "D" : "hr:";
  const std::string bit = fx ? "M" : "co:";
  const Json allow = fx ? Json{"M100-M999", "D1000-D1999"} : Json{"co:100-999", "hr:1000-1999"};
  Json made{{"name", name},
            {"link", name},
            {"protocol", protocol},
            {"timeout_ms", 200},
            {"retries", 1},
            {"tags", tags(word, bit, fx ? kArrayOfFx : kArrayOfModbus)},
            {"commands", {{"allow", allow}, {"allow_run_stop", true}, {"queue", 6}}}};
  if (fx) made["model"] = "FX3U";
  return made;
}

}  // namespace

std::string plant_of_the_path() {
  constexpr std::array<const char*, kPathDevices> kProtocols{
      "fx-programming-port", "fx-computer-link", "modbus-tcp", "modbus-rtu"};
  Json links = Json::array();
  Json devices = Json::array();
  for (std::size_t i = 0; i < kNames.size(); ++i) {
    Json link{{"name", kNames[i]}, {"tcp", {{"host", "192.0.2.1"}, {"port", 4000 + i}}}};
    if (i != 2) link["line_baud"] = 19200;
    links.push_back(std::move(link));
    devices.push_back(device(kNames[i], kProtocols[i], i < 2));
  }
  return Json{{"agent", {{"id", "edge7"}, {"root", "fx/path"}}},
              {"mqtt", {{"servers", {"mqtt://127.0.0.1:1883"}}}},
              {"links", std::move(links)},
              {"devices", std::move(devices)}}
      .dump(1);
}

std::string RandomCommands::word_address(std::uint32_t device, unsigned number) const {
  return (is_fx(device) ? "D" : "hr:") + std::to_string(number);
}
std::string RandomCommands::bit_address(std::uint32_t device, unsigned number) const {
  return (is_fx(device) ? "M" : "co:") + std::to_string(number);
}

// ---- targets ------------------------------------------------------------------------------------

RandomCommands::Target RandomCommands::word_target(std::uint32_t device) {
  const unsigned value = fresh();
  const bool raw = fate_.one_in(4);
  const auto number = static_cast<unsigned>(raw ? fate_.between(1000, 1049) : fate_.between(0, 7));
  Json json{{"value", value}};
  if (raw)
    json["address"] = word_address(device, number);
  else
    json["tag"] = "w" + std::to_string(number);
  return {std::move(json), {{{Deed{false, raw ? number : 100 + number, value}}}}};
}

RandomCommands::Target RandomCommands::array_target(std::uint32_t device) {
  Target made;
  const bool raw = fate_.one_in(4);
  const bool second = fate_.one_in(2);
  const unsigned first = raw ? 1100 : (second ? 500 : 200);
  const unsigned full = is_fx(device) ? kArrayOfFx : kArrayOfModbus;
  const unsigned count = raw ? static_cast<unsigned>(fate_.between(2, 90)) : full;
  Json values = Json::array();
  for (unsigned i = 0; i < count; ++i) {
    values.push_back(fresh());
    made.wanted.elements.push_back({Deed{false, first + i, fresh_}});
  }
  if (raw)
    made.json["address"] = word_address(device, first);
  else
    made.json["tag"] = second ? "a1" : "a0";
  made.json["value"] = std::move(values);
  return made;
}

std::vector<Deed> RandomCommands::long_deeds(std::uint32_t device, unsigned number,
                                             std::uint32_t value) const {
  const unsigned low = is_fx(device) ? 0 : 1;  // where the low word stands
  return {Deed{false, number + low, value & 0xFFFFU}, Deed{false, number + 1 - low, value >> 16U}};
}

RandomCommands::Target RandomCommands::long_target(std::uint32_t device) {
  Target made;
  const auto next = [&](unsigned number) {
    const std::uint32_t value = (fresh() << 16U) + fresh();
    made.wanted.elements.push_back(long_deeds(device, number, value));
    return value;
  };
  if (fate_.one_in(3)) {
    made.json = {{"tag", "la"}, {"value", Json::array()}};
    for (unsigned i = 0; i < kLongs; ++i) made.json["value"].push_back(next(820 + 2 * i));
  } else {
    const auto i = static_cast<unsigned>(fate_.between(0, 3));
    made.json = {{"tag", "l" + std::to_string(i)}, {"value", next(800 + 2 * i)}};
  }
  return made;
}

RandomCommands::Target RandomCommands::float_target(std::uint32_t device) {
  const std::uint32_t bits = ((0x4000U + fresh() % 0x3000U) << 16U) + fresh();
  return {Json{{"tag", "f0"}, {"value", static_cast<double>(std::bit_cast<float>(bits))}},
          {{long_deeds(device, 900, bits)}}};
}

RandomCommands::Target RandomCommands::text_target(std::uint32_t device) {
  Target made;
  made.wanted.per_element = 2;
  const bool is_long = fate_.one_in(2);
  std::string text;
  for (unsigned i = 0; i < (is_long ? 50U : 4U); ++i) {
    const unsigned number = fresh();
    const unsigned first = '0' + number % 64U;
    const unsigned second = '0' + number / 64U % 64U;
    text += static_cast<char>(first);
    text += static_cast<char>(second);
    const unsigned value = is_fx(device) ? second * 256 + first : first * 256 + second;
    made.wanted.elements.push_back({Deed{false, (is_long ? 920U : 910U) + i, value}});
  }
  made.json = {{"tag", is_long ? "s1" : "s0"}, {"value", text}};
  return made;
}

RandomCommands::Target RandomCommands::limited_target(std::uint32_t device) {
  Once& once = next_once_[device];
  if (once.limited > kLastLimited) return word_target(device);
  const unsigned number = once.limited++;
  // The nearest raw numbers to the limits lie inside and outside of them.
  constexpr std::array<double, 8> kValues{0.36, 0.5, 50.04, 99.94, 0.34, 0.349, 99.955, 99.97};
  constexpr std::array<unsigned, 8> kRaw{4, 5, 500, 999, 3, 3, 1000, 1000};
  const auto i = static_cast<std::size_t>(fate_.between(0, 7));
  return {Json{{"tag", "lim" + std::to_string(number)}, {"value", kValues[i]}},
          {{{Deed{false, number, kRaw[i]}}}}};
}

RandomCommands::Target RandomCommands::bit_target(std::uint32_t device) {
  Once& once = next_once_[device];
  Target made;
  if (!once.flags && fate_.one_in(4)) {
    once.flags = true;
    made.json = {{"tag", "flags"}, {"value", Json::array()}};
    for (unsigned i = 0; i < kFlags; ++i) {
      const bool on = !devices_[device]->bit(kFirstFlag + i);
      made.json["value"].push_back(on);
      made.wanted.elements.push_back({Deed{true, kFirstFlag + i, on ? 1U : 0U}});
    }
    return made;
  }
  const bool by_tag = once.flag < 10 && fate_.one_in(3);
  const unsigned number = by_tag ? once.flag++ : once.bit++;
  // What it is already would be read back whether it was set or not.
  const bool on = !devices_[device]->bit(number);
  made.json["value"] = on;
  if (by_tag)
    made.json["tag"] = "t" + std::to_string(number);
  else
    made.json["address"] = bit_address(device, number);
  made.wanted.elements.push_back({Deed{true, number, on ? 1U : 0U}});
  return made;
}

RandomCommands::Target RandomCommands::target(std::uint32_t device) {
  // The values of a scene are not without end.
  const bool room = fresh_ < 25000;
  switch (fate_.between(0, 12)) {
    case 0:
    case 7:
      return room ? array_target(device) : word_target(device);
    case 1:
      return room ? long_target(device) : word_target(device);
    case 2:
      return float_target(device);
    case 3:
      // Two characters tell so many numbers apart.
      return fresh_ < 4000 ? text_target(device) : word_target(device);
    case 4:
      return limited_target(device);
    case 5:
    case 6:
      return bit_target(device);
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
  const unsigned bit = next_once_[sent.device].bit++;
  const bool on = !devices_[sent.device]->bit(bit);
  sent.op = command["op"] = on ? "force_on" : "force_off";
  command["address"] = bit_address(sent.device, bit);
  sent.targets.push_back({{{Deed{true, bit, on ? 1U : 0U}}}});
}

void RandomCommands::read(SentCommand& sent, Json& command) {
  constexpr std::array<const char*, 7> kTags{"w0", "a0", "la", "s1", "ro", "t0", "flags"};
  if (fate_.one_in(3))
    command["address"] = word_address(sent.device, 1000);
  else
    command["tag"] = kTags[static_cast<std::size_t>(fate_.between(0, 6))];
}

void RandomCommands::switch_plc(SentCommand& sent, Json& command) {
  Once& once = next_once_[sent.device];
  bool& used = sent.op == "run" ? once.run : once.stop;
  if (used) {  // one of each in a scene, so that it is known whose it was
    sent.op = command["op"] = "read";
    return read(sent, command);
  }
  used = true;
  if (!is_fx(sent.device)) sent.is_wrong = true;
}

void RandomCommands::add_conditions(SentCommand& sent, Json& command, std::int64_t utc_ms) {
  const bool writes = !sent.targets.empty();
  if (fate_.one_in(3))
    command["expires"] = utc_ms + fate_.between(-20, fate_.one_in(2) ? 300 : 2500);
  if (writes && fate_.one_in(2)) command["verify"] = fate_.one_in(2);
  if (fate_.one_in(20)) sent.message_expiry_s = fate_.between(0, 2);
  if (fate_.one_in(25)) sent.dry_run = command["dry_run"] = true;
  if (fate_.one_in(4)) command["by"] = "anna";
  const bool one_word = writes && !sent.is_list && sent.targets[0].elements.size() == 1 &&
                        sent.targets[0].elements[0].size() == 1 && !command.contains("targets");
  if (!one_word || !fate_.one_in(4)) return;
  const Deed& deed = sent.targets[0].elements[0][0];
  const bool limited = deed.number >= kFirstLimited && deed.number <= kLastLimited;
  if (limited && !deed.is_bit) return;
  const LedgerDevice& device = *devices_[sent.device];
  if (deed.is_bit)
    command["expect"] = fate_.one_in(4) != device.bit(deed.number);
  else
    command["expect"] = fate_.one_in(4) ? 7U : device.word(deed.number);
}

void RandomCommands::spoil(SentCommand& sent, Json& command) {
  sent.is_wrong = true;
  sent.targets.clear();
  sent.is_list = false;
  for (const char* key : {"tag", "address", "type", "value", "targets", "expect"})
    command.erase(key);
  command["op"] = sent.op = "write";
  command["value"] = fresh();
  const Json right{{"tag", "w0"}, {"value", fresh()}};
  switch (fate_.between(0, 12)) {
    case 0:
      command["tag"] = "nothing";
      break;
    case 1:
      command["address"] = word_address(sent.device, 100);  // a tag's, but not in allow
      break;
    case 2:
      command["tag"] = "ro";
      break;
    case 3:
      command.erase("value");
      command["tag"] = "w1";
      break;
    case 4:
      command.update({{"tag", "w1"}, {"value", 70000}});
      break;
    case 5:
      command.update({{"tag", "w1"}, {"value", "eleven"}});
      break;
    case 6:
      command.update({{"tag", "lim980"}, {"value", 200.0}});
      break;
    case 7:
      command.update({{"tag", "w1"}, {"valeu", 4}});
      break;
    case 8:
      command.update({{"tag", "w1"}, {"op", "reset"}});
      sent.op = "reset";
      break;
    case 9:
      command.update({{"tag", "w1"}, {"status", "SUCCEEDED"}});
      break;
    case 10: {
      command.erase("value");
      command["targets"] = {right, Json{{"tag", "nothing"}, {"value", 1}}, right};
      break;
    }
    case 11: {
      command.erase("value");
      command["targets"] = Json::array();
      for (int i = 0; i < 65; ++i) command["targets"].push_back(right);
      break;
    }
    default:
      command["tag"] = "w1";
      sent.retained = true;
  }
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
