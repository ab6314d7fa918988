#include "agent/handover/command_message.h"

#include <algorithm>
#include <variant>

namespace fxagent {
namespace {

// Words of the enumerators, in their order.
constexpr auto kOps =
    std::to_array<std::string_view>({"write", "force_on", "force_off", "read", "run", "stop"});
constexpr auto kReasons = std::to_array<std::string_view>({"",
                                                           "too_large",
                                                           "bad_json",
                                                           "missing_id",
                                                           "duplicate_id",
                                                           "retained",
                                                           "unknown_device",
                                                           "bad_op",
                                                           "unknown_tag",
                                                           "bad_address",
                                                           "not_writable",
                                                           "not_allowed",
                                                           "bad_value",
                                                           "out_of_range",
                                                           "expired",
                                                           "queue_full",
                                                           "conflict",
                                                           "expect_mismatch",
                                                           "nak",
                                                           "timeout",
                                                           "bad_frame",
                                                           "link_down",
                                                           "device_offline",
                                                           "verify_mismatch",
                                                           "broadcast",
                                                           "shutting_down",
                                                           "reloading",
                                                           "yielded",
                                                           "store_unavailable",
                                                           "interrupted"});
constexpr auto kAnswers = std::to_array<std::string_view>({"", "ACK", "NAK"});
constexpr auto kStatuses = std::to_array<std::string_view>(
    {"SUCCEEDED", "FAILED", "PARTIAL", "REJECTED", "EXPIRED", "DUPLICATE", "UNKNOWN_OUTCOME"});
static_assert(kOps.size() == static_cast<std::size_t>(Op::stop) + 1);
static_assert(kReasons.size() == static_cast<std::size_t>(Reason::interrupted) + 1);
static_assert(kAnswers.size() == static_cast<std::size_t>(PlcAnswer::nak) + 1);
static_assert(kStatuses.size() == kCommandStatuses.size());

std::size_t memory_of(const Value& value) {
  std::size_t bytes = value.items.capacity() * sizeof(Scalar);
  for (const Scalar& item : value.items)
    if (const auto* text = std::get_if<std::string>(&item)) bytes += text->capacity();
  return bytes;
}

std::size_t memory_of(const std::optional<Value>& value) { return value ? memory_of(*value) : 0; }

}  // namespace

std::string_view to_string(Op op) { return kOps[static_cast<std::size_t>(op)]; }

std::optional<Op> op_from(std::string_view word) {
  const auto found = std::ranges::find(kOps, word);
  if (found == kOps.end()) return std::nullopt;
  return static_cast<Op>(found - kOps.begin());
}

std::string_view to_string(Reason reason) { return kReasons[static_cast<std::size_t>(reason)]; }
std::string_view to_string(PlcAnswer answer) { return kAnswers[static_cast<std::size_t>(answer)]; }
std::string_view to_string(CommandStatus status) {
  return kStatuses[static_cast<std::size_t>(status)];
}

std::size_t memory_of(const Command& command) {
  std::size_t bytes = sizeof(command) + command.by.capacity() + command.response_topic.capacity() +
                      command.correlation.capacity() + memory_of(command.expect);
  for (const CommandTarget& target : command.targets)
    bytes += sizeof(target) + target.tag.capacity() + target.address.capacity() +
             memory_of(target.value) + (target.fault ? target.fault->detail.capacity() : 0);
  return bytes;
}

}  // namespace fxagent
