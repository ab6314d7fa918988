#include "tests/fleet/texts.h"

#include <chrono>
#include <nlohmann/json.hpp>

namespace fxfleet {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kHealthBytes = 957;

std::string tag(int number) { return "temp" + std::to_string(number); }

}  // namespace

std::int64_t utc_ms() {
  using std::chrono::milliseconds;
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  return std::chrono::duration_cast<milliseconds>(now).count();
}

std::string agent_state(std::string_view boot, std::int64_t since) {
  return Json{{"state", "online"}, {"since", since}, {"boot", boot}, {"version", "0.1.0"}}.dump();
}

std::string agent_will(std::string_view boot) {
  return Json{{"state", "offline"}, {"since", nullptr}, {"reason", "lost"}, {"boot", boot}}.dump();
}

std::string device_state(std::int64_t since) {
  return Json{{"state", "online"}, {"since", since},
              {"reason", nullptr}, {"reason_text", nullptr},
              {"model", "FX3U"},   {"model_configured", nullptr},
              {"run", true}}
      .dump();
}

std::string device_meta() {
  Json tags;
  for (int number = 0; number < 8; ++number)
    tags[tag(number)] = {{"address", "D" + std::to_string(100 + number)},
                         {"type", "int16"},
                         {"unit", ""},
                         {"scale", 1},
                         {"offset", 0},
                         {"group", "fast"},
                         {"access", "read"}};
  return Json{{"hash", "67803c8568717927"}, {"tags", tags}}.dump();
}

std::string health(std::string_view boot, std::uint64_t samples) {
  Json text{{"ts", utc_ms()}, {"boot", boot}, {"samples", {{"collected", samples}}}, {"fill", ""}};
  const std::size_t size = text.dump().size();
  if (size < kHealthBytes) text["fill"] = std::string(kHealthBytes - size, 'x');
  return text.dump();
}

std::string sample(std::string_view boot, std::uint64_t seq, std::int64_t ts) {
  // By hand, because a fleet makes thousands of them in a second.
  std::string text = "{\"ts\":" + std::to_string(ts) + ",\"seq\":" + std::to_string(seq) +
                     ",\"boot\":\"" + std::string(boot) +
                     "\",\"meta\":\"67803c8568717927\",\"values\":{";
  for (int number = 0; number < 8; ++number)
    text += (number > 0 ? ",\"" : "\"") + tag(number) +
            "\":" + std::to_string((seq + static_cast<std::uint64_t>(number)) % 10);
  return text + "}}";
}

std::string history(const std::vector<std::string>& rows) {
  std::string text = "{\"history\":true,\"rows\":[";
  for (const std::string& row : rows) {
    if (text.back() != '[') text += ',';
    text += row;
  }
  return text + "]}";
}

std::string result(std::string_view id, bool is_duplicate) {
  Json text{{"id", id},
            {"status", is_duplicate ? "DUPLICATE" : "SUCCEEDED"},
            {"reason", nullptr},
            {"detail", nullptr},
            {"plc", "ACK"},
            {"op", "write"},
            {"tag", nullptr},
            {"address", "D300"},
            {"value", 3},
            {"verify", {{"read", 3}, {"match", true}}},
            {"t",
             {{"received", utc_ms()},
              {"queue_ms", 0.12},
              {"wire_ms", 40.951},
              {"total_ms", 41.594},
              {"bound_ms", 175.417}}},
            {"attempts", 1}};
  if (is_duplicate) text["reason"] = "duplicate_id";
  return text.dump();
}

}  // namespace fxfleet
