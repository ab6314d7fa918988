// What is to be simulated: the configuration file and its short form on the command line.
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

namespace fxsim {

/// The text names the key.
class ConfigError final : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// What all stations of a line share.
struct LineSettings {
  std::string pty;                   // path of the link to it; empty: a TCP listener instead
  std::uint16_t tcp = 0;             // port, 0: any free one
  std::optional<std::uint16_t> udp;  // a port for datagrams in the place of a TCP listener
  std::uint16_t udp_peer_port = 0;   // the only one that is heard; 0: all
  unsigned connections = 0;          // TCP: more at a time are closed at once; 0: no limit
  std::string listen = "127.0.0.1";  // address of the TCP listener
  unsigned baud = 9600;              // 0: as fast as it goes
  unsigned bits_per_character = 10;  // start, data, parity and stop
  bool gateway = false;              // a request that no station answers gets nobody_there()
};

/// How long one station takes before it answers.
struct ResponseTime {
  std::chrono::milliseconds turnaround{5};
  std::chrono::milliseconds jitter{0};  // up to this much more turnaround
  std::uint32_t seed = 1;
};

struct PlcConfig {
  std::string name;
  Protocol protocol = Protocol::programming_port;
  const Model* model = nullptr;
  LineSettings line;
  std::size_t line_of = 0;  // index of the first PLC on this line, its own where it is that
  ResponseTime response;
  ComputerLinkSettings computer_link;
  ModbusSettings modbus;
  McSettings mc;
  std::string plant = "none";
  bool run = true;
  bool run_switch = true;
  std::vector<std::pair<Device, std::uint32_t>> memory;
  std::vector<Fault> faults;
};

/// Reads {"plcs": [...]}, with repetitions written out. Throws ConfigError at the first mistake.
std::vector<PlcConfig> parse_config(const nlohmann::json& root);
/// Turns "name=p1,model=FX3U,pty=/tmp/p1,baud=9600" into one entry of "plcs".
nlohmann::json plc_from_short_form(std::string_view text);

/// What speaks the PLC's protocol.
std::unique_ptr<Personality> make_personality(const PlcConfig& plc);

/// Reads a fault of a station that speaks `protocol`, as the file and the control socket write it.
/// `where` begins an error's text.
Fault parse_fault(const nlohmann::json& object, Protocol protocol, const std::string& where);
/// A raw value from -2^(width-1) to 2^width-1, or a bool for a bit; its low bits.
std::uint32_t parse_value(const nlohmann::json& value, Device device, const std::string& where);
/// The device `name` of `model`. Throws ConfigError where there is none.
Device parse_device_of(const Model& model, std::string_view name, const std::string& where);

}  // namespace fxsim
