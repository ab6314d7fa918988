// The simulator's configuration file and its short form on the command line.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "tests/sim/computer_link.h"
#include "tests/sim/fault.h"
#include "tests/sim/mc.h"
#include "tests/sim/modbus.h"
#include "tests/sim/model.h"
#include "tests/sim/recorded.h"

namespace fxsim {

/// A mistake in the configuration. The text names the key.
class ConfigError final : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// The settings that all stations of a line share.
struct LineSettings {
  std::string pty;                   // path of its symbolic link; empty: a TCP listener instead
  std::uint16_t tcp = 0;             // port; 0: any free one
  std::optional<std::uint16_t> udp;  // port for datagrams, instead of a TCP listener
  std::uint16_t udp_peer_port = 0;   // accepts datagrams from this port only; 0: from any
  unsigned connections = 0;          // TCP: closes any connection beyond this many; 0: no limit
  std::string listen = "127.0.0.1";  // address of the TCP listener
  unsigned baud = 9600;              // 0: unlimited
  unsigned bits_per_character = 10;  // start, data, parity and stop
  bool strict = false;               // pty: deaf to a client with other speed, parity or stop bits
  std::string parity = "even";       // even, odd or none
  bool two_stop_bits = false;
  bool gateway = false;  // answers nobody_there() when no station replies
};

/// The time a station takes before it answers.
struct ResponseTime {
  std::chrono::milliseconds turnaround{5};
  std::chrono::milliseconds jitter{0};  // random extra turnaround, up to this much
  std::uint32_t seed = 1;
};

struct PlcConfig {
  std::string name;
  Protocol protocol = Protocol::programming_port;
  const Model* model = nullptr;
  LineSettings line;
  std::size_t line_of = 0;  // index of the first PLC on this line, possibly its own
  ResponseTime response;
  ComputerLinkSettings computer_link;
  ModbusSettings modbus;
  McSettings mc;
  std::string plant = "none";
  bool run = true;
  bool run_switch = true;
  std::vector<std::pair<Device, std::uint32_t>> memory;
  std::vector<Fault> faults;
  std::shared_ptr<const Recording> recording;  // answers in place of the protocol, if not null
};

/// Parses {"plcs": [...]} and expands repetitions. Throws ConfigError at the first mistake.
std::vector<PlcConfig> parse_config(const nlohmann::json& root);
/// Converts "name=p1,model=FX3U,pty=/tmp/p1,baud=9600" to an entry of "plcs".
nlohmann::json plc_from_short_form(std::string_view text);
/// Returns the line of a recording as a PLC. `place`: "pty=PATH", "tcp=PORT" or "udp=PORT"; empty:
/// a free TCP or UDP port, as the recorded line had.
PlcConfig recorded_plc(Recording recording, std::string place);

/// Creates the implementation of the PLC's protocol.
std::unique_ptr<Personality> make_personality(const PlcConfig& plc);

/// Parses a fault for a station of `protocol`, in the notation of the file and the control socket.
/// Error texts begin with `where`.
Fault parse_fault(const nlohmann::json& object, Protocol protocol, const std::string& where);
/// Parses a raw value from -2^(width-1) to 2^width-1, or a bool for a bit. Returns the low bits.
std::uint32_t parse_value(const nlohmann::json& value, Device device, const std::string& where);
/// Returns the device `name` of `model`. Throws ConfigError if the model does not have it.
Device parse_device_of(const Model& model, std::string_view name, const std::string& where);

}  // namespace fxsim
