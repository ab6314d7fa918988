#include "protocol/explanation.h"

#include <algorithm>
#include <cstddef>

namespace fxagent {
namespace {

constexpr std::size_t kMostValues = 16;

std::string listed(const std::vector<std::string>& values) {
  std::string text;
  for (std::size_t i = 0; i < std::min(values.size(), kMostValues); ++i) text += " " + values[i];
  return values.size() > kMostValues ? text + " …" : text;
}

/// Returns the reason of a refusal if its protocol gives one.
std::string reason_of(const Explanation& nak) {
  for (const auto& [name, meaning] : nak.fields)
    if (name == "reason" || name == "exception") return " " + meaning;
  return {};
}

}  // namespace

std::string summary(const Explanation& frame) {
  std::string text = frame.operation;
  if (frame.device) text += " " + *frame.device;
  if (frame.operation == "nak") return text + reason_of(frame);
  const bool is_counted = frame.count && (frame.device || frame.values.empty());
  if (is_counted) text += " × " + std::to_string(*frame.count);
  if (!frame.values.empty()) text += (frame.device ? " =" : "") + listed(frame.values);
  for (const auto& [name, meaning] : frame.fields)
    if (name == "meaning") text += ", " + meaning;
  if (frame.error) text += ": " + *frame.error;
  return text;
}

}  // namespace fxagent
