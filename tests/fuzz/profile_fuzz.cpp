// Feeds an arbitrary message to the profiles that hear commands. The first byte of the input
// selects the profile and the topic, the rest is the payload. Nothing may crash, and each command
// must be JSON with one value, or empty.
#include <cstdint>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string>

#include "agent/uplink/profile/plain_profile.h"
#include "agent/uplink/sparkplug/sparkplug_profile.h"
#include "agent/uplink/sparkplug/typed_commands.h"
#include "tests/agent/uplink/plant.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace fxagent;
  if (size == 0) return 0;
  const Config config = test::plant();
  const auto take = [](const RelayedCommand& each) {
    if (each.payload.empty()) return;  // admission refuses it
    const auto command = nlohmann::json::parse(each.payload, nullptr, false);
    if (!command.is_object() || command["op"] != "write" || !command.contains("value") ||
        command.size() != 4)
      std::abort();
  };
  const auto new_id = [] { return std::string("id"); };
  Message message;
  message.payload.assign(reinterpret_cast<const char*>(data) + 1, size - 1);
  message.retained = (data[0] & 8) != 0;
  ProfileConfig what;
  what.topic = "{root}/{id}/{device}/{tag}";
  what.group = "g";
  what.node = "n";
  what.host = "h";
  if (data[0] % 4 == 0) {
    what.kind = ProfileConfig::Kind::plain;
    PlainProfile profile(config, what, take, new_id);
    message.topic = "fx/plant-a/edge7/press1/setpoint/set";
    profile.hear(message);
    return 0;
  }
  if ((data[0] & 32) != 0) {
    std::size_t relayed = 0;
    const auto carry_out = [&](const RelayedCommand& each) {
      ++relayed;
      const auto command = nlohmann::json::parse(each.payload, nullptr, false);
      if (!command.contains("op")) std::abort();
      each.reply(R"({"status":"SUCCEEDED","value":1})");
    };
    what.kind = ProfileConfig::Kind::sparkplug_commands;
    what.host.clear();
    TypedCommandsProfile profile(config, what, carry_out, [] { return std::int64_t{1}; });
    profile.connection_began(Connected{});
    const std::size_t births = profile.due(SteadyTime{}, 1).size();
    constexpr const char* topics[] = {"", "spCv1.0/g/NCMD/n", "spCv1.0/g/DCMD/n/press1",
                                      "spCv1.0/g/REBIRTH/n"};
    message.topic = topics[data[0] % 4];
    profile.hear(message);
    std::size_t answers = 0;
    while (const std::size_t next = profile.due(SteadyTime{}, 1).size()) answers += next;
    if (births != 1 || answers < relayed) std::abort();
    return 0;
  }
  what.kind = ProfileConfig::Kind::sparkplug;
  what.old_state = (data[0] & 16) != 0;
  SparkplugProfile profile(config, what, take, new_id, [] { return std::int64_t{1}; });
  profile.connection_began(Connected{});
  constexpr const char* topics[] = {"", "spBv1.0/g/NCMD/n", "spBv1.0/g/DCMD/n/press1",
                                    "spBv1.0/STATE/h"};
  message.topic = topics[data[0] % 4];
  if (what.old_state && data[0] % 4 == 3) message.topic = "STATE/h";
  profile.hear(message);
  profile.due(SteadyTime{}, 1);
  return 0;
}
