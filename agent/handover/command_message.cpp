#include "agent/handover/command_message.h"

#include <algorithm>
#include <array>
#include <utility>
#include <variant>

namespace fxagent {
namespace {

constexpr std::array<std::pair<Op, std::string_view>, 6> kOps{{{Op::write, "write"},
                                                               {Op::force_on, "force_on"},
                                                               {Op::force_off, "force_off"},
                                                               {Op::read, "read"},
                                                               {Op::run, "run"},
                                                               {Op::stop, "stop"}}};

}  // namespace

void FrameTrace::add(WireFrame::Way way, ByteView bytes) {
  if (bytes.empty()) return;
  if (frames_.size() >= kMostFrames || bytes_ + bytes.size() > kMostBytes) {
    ++omitted_;
    return;
  }
  bytes_ += bytes.size();
  frames_.push_back({way, Bytes(bytes.begin(), bytes.end())});
}

std::string_view to_string(Op op) {
  const auto* found =
      std::find_if(kOps.begin(), kOps.end(), [op](const auto& known) { return known.first == op; });
  return found == kOps.end() ? std::string_view() : found->second;
}

std::optional<Op> op_from(std::string_view word) {
  const auto* found = std::find_if(kOps.begin(), kOps.end(),
                                   [word](const auto& known) { return known.second == word; });
  if (found == kOps.end()) return std::nullopt;
  return found->first;
}

std::string_view to_string(Reason reason) {
  switch (reason) {
    case Reason::none:
      return "";
    case Reason::too_large:
      return "too_large";
    case Reason::bad_json:
      return "bad_json";
    case Reason::missing_id:
      return "missing_id";
    case Reason::duplicate_id:
      return "duplicate_id";
    case Reason::retained:
      return "retained";
    case Reason::unknown_device:
      return "unknown_device";
    case Reason::bad_op:
      return "bad_op";
    case Reason::unknown_tag:
      return "unknown_tag";
    case Reason::bad_address:
      return "bad_address";
    case Reason::not_writable:
      return "not_writable";
    case Reason::not_allowed:
      return "not_allowed";
    case Reason::bad_value:
      return "bad_value";
    case Reason::out_of_range:
      return "out_of_range";
    case Reason::expired:
      return "expired";
    case Reason::queue_full:
      return "queue_full";
    case Reason::conflict:
      return "conflict";
    case Reason::expect_mismatch:
      return "expect_mismatch";
    case Reason::nak:
      return "nak";
    case Reason::timeout:
      return "timeout";
    case Reason::bad_frame:
      return "bad_frame";
    case Reason::link_down:
      return "link_down";
    case Reason::device_offline:
      return "device_offline";
    case Reason::verify_mismatch:
      return "verify_mismatch";
    case Reason::broadcast:
      return "broadcast";
    case Reason::shutting_down:
      return "shutting_down";
    case Reason::reloading:
      return "reloading";
    case Reason::yielded:
      return "yielded";
    case Reason::store_unavailable:
      return "store_unavailable";
    case Reason::interrupted:
      return "interrupted";
  }
  return "";
}

std::string_view to_string(PlcAnswer answer) {
  switch (answer) {
    case PlcAnswer::none:
      return "";
    case PlcAnswer::ack:
      return "ACK";
    case PlcAnswer::nak:
      return "NAK";
  }
  return "";
}

std::string_view to_string(CommandStatus status) {
  switch (status) {
    case CommandStatus::succeeded:
      return "SUCCEEDED";
    case CommandStatus::failed:
      return "FAILED";
    case CommandStatus::partial:
      return "PARTIAL";
    case CommandStatus::rejected:
      return "REJECTED";
    case CommandStatus::expired:
      return "EXPIRED";
    case CommandStatus::duplicate:
      return "DUPLICATE";
    case CommandStatus::unknown_outcome:
      return "UNKNOWN_OUTCOME";
  }
  return "UNKNOWN_OUTCOME";
}

namespace {

std::size_t memory_of(const Value& value) {
  std::size_t bytes = value.items.capacity() * sizeof(Scalar);
  for (const Scalar& item : value.items)
    if (const auto* text = std::get_if<std::string>(&item)) bytes += text->capacity();
  return bytes;
}

std::size_t memory_of(const std::optional<Value>& value) { return value ? memory_of(*value) : 0; }

}  // namespace

std::size_t memory_of(const Command& command) {
  std::size_t bytes = sizeof(command) + command.by.capacity() + command.response_topic.capacity() +
                      command.correlation.capacity() + memory_of(command.expect);
  for (const CommandTarget& target : command.targets)
    bytes += sizeof(target) + target.tag.capacity() + target.address.capacity() +
             memory_of(target.value) + (target.fault ? target.fault->detail.capacity() : 0);
  return bytes;
}

}  // namespace fxagent
