#include "agent/config/read/devices/model_name.h"

#include <algorithm>
#include <vector>

#include "agent/config/suggestions.h"
#include "protocol/letter_case.h"

namespace fxagent {
namespace {

/// Returns the protocols that support the model: "mc-1e over Ethernet, fx-computer-link on a serial
/// line". If `own` does not run on serial lines and other Ethernet protocols support the model,
/// returns only these.
std::string protocols_of(std::string_view model, const ProtocolInfo& own) {
  std::vector<std::string_view> serial;
  std::vector<std::string_view> ethernet;
  for (const ProtocolInfo& info : catalog())
    if (knows_model(info, model)) (info.on_serial ? serial : ethernet).push_back(info.name);
  if (ethernet.empty()) return one_of(serial);
  if (!own.on_serial || serial.empty()) return one_of(ethernet);
  return one_of(ethernet) + " over Ethernet, " + one_of(serial) + " on a serial line";
}

}  // namespace

bool knows_model(const ProtocolInfo& protocol, std::string_view model) {
  return std::ranges::find(protocol.models, model) != protocol.models.end() ||
         std::ranges::find(protocol.kin, model) != protocol.kin.end();
}

std::string_view model_meant(std::string_view said) {
  const std::string name = upper(said);
  const bool is_modular = name.size() > 1 && name[1] >= '0' && name[1] <= '9';
  if (is_modular && name[0] == 'Q') return "Q";
  if (is_modular && name[0] == 'L') return "L";
  if (is_modular && name[0] == 'R') return "iQ-R";
  std::string_view meant;
  for (const ProtocolInfo& info : catalog())
    for (const auto* names : {&info.models, &info.kin})
      for (const std::string_view model : *names) {
        const bool is_it = name == upper(model) || name.starts_with(std::string(model) + "-");
        if (is_it) meant = model;
      }
  return meant;
}

std::string model_is_not_reached(const ProtocolInfo& own, std::string_view model) {
  std::string text = std::string(own.name) + " does not reach " + (model == "Q" ? "a " : "an ") +
                     std::string(model) + "; use " + protocols_of(model, own);
  if (model.starts_with("FX5"))
    text += ", or modbus-tcp or modbus-rtu without \"model\" if its parameters enable that";
  return text;
}

}  // namespace fxagent
