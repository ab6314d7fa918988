// Explains a frame, for `fxagent decode` and the line trace: its parts, and a summary in one line.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace fxagent {

/// Direction of a frame: to the device, or from it.
enum class Direction : std::uint8_t { request, reply };

/// Output of `fxagent decode` for one frame. Optional fields are set if the frame has that part.
struct Explanation {
  bool ok = false;
  Direction direction = Direction::request;
  bool ambiguous = false;              ///< the bytes are a valid frame in both directions
  std::string operation;               ///< read write force_on force_off enquire ack nak data other
  std::optional<std::string> command;  ///< "0", "E00", "BR", "03" …
  std::optional<std::string> command_set;  ///< "classic" or "extended"
  std::optional<std::uint32_t> format;  ///< if the protocol has several formats around one content
  /// Head device as the manual writes it; for a scattered write all devices: "M50,S100,Y1".
  std::optional<std::string> device;
  std::optional<std::uint32_t> count;  ///< devices of that kind: words, or bits
  std::vector<std::string> values;     ///< words as 4 hex digits, bits as 0/1
  std::optional<std::string> checksum_given;
  std::optional<std::string> checksum_computed;
  std::optional<std::string> error;  ///< the reason if the frame is not valid
  /// Name and meaning of each part, in order.
  std::vector<std::pair<std::string, std::string>> fields;
};

/// Returns for example "read D123 × 2", "data 1234 ABCD" or "nak 06, device number out of range".
/// For a bad frame: the parts that are known, a colon and the reason. Lists at most 16 values.
std::string summary(const Explanation& frame);

}  // namespace fxagent
