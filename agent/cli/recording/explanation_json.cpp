#include "agent/cli/recording/explanation_json.h"

#include <nlohmann/json.hpp>

namespace fxagent {

nlohmann::ordered_json explanation_json(const Explanation& frame) {
  nlohmann::ordered_json out;
  const auto put = [&](const char* key, const auto& value) {
    if (value) out[key] = *value;
  };
  out["ok"] = frame.ok;
  out["direction"] = frame.direction == Direction::request ? "request" : "reply";
  out["ambiguous"] = frame.ambiguous;
  out["operation"] = frame.operation;
  put("command", frame.command);
  put("command_set", frame.command_set);
  put("device", frame.device);
  put("count", frame.count);
  if (!frame.values.empty()) out["values"] = frame.values;
  if (frame.checksum_given || frame.checksum_computed) {
    auto& sum = out["checksum"] = nlohmann::ordered_json::object();
    if (frame.checksum_given) sum["given"] = *frame.checksum_given;
    if (frame.checksum_computed) sum["computed"] = *frame.checksum_computed;
  }
  out["error"] = nullptr;
  put("error", frame.error);
  return out;
}

}  // namespace fxagent
