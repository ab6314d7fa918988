#include "agent/cli/subcommands.h"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <iostream>
#include <string>
#include <vector>

#include "agent/cli/doctor/examined_device.h"
#include "agent/cli/doctor/fixed_config.h"
#include "agent/cli/doctor/guesses.h"
#include "agent/cli/exit_status.h"
#include "agent/log/log.h"
#include "agent/process/port_access.h"
#include "protocol/checklist.h"

namespace fxagent {
namespace {

// A guess has this many characters, request and answer together, at most; and greet() may ask
// twice.
constexpr int kGuessCharacters = 120;
constexpr std::size_t kMostStations = 4;

struct Guess {
  const ProtocolInfo* protocol;
  LineDefaults line;
};

std::vector<Guess> all_guesses() {
  std::vector<Guess> guesses;
  for (const ProtocolInfo& protocol : catalog())
    if (protocol.on_serial)
      for (const LineDefaults& line : line_guesses(protocol, protocol.line))
        guesses.push_back({&protocol, line});
  return guesses;
}

/// Returns the likeliest addresses; one that means nothing if the protocol has none.
std::vector<std::int64_t> few_stations(const ProtocolInfo& protocol) {
  const auto options = default_options(protocol);
  const auto* own = option<std::int64_t>(options, station_key(protocol));
  auto stations = station_guesses(protocol, own == nullptr ? 0 : *own);
  stations.resize(std::min(stations.size(), kMostStations));
  return stations;
}

std::chrono::nanoseconds longest_time(const std::vector<Guess>& guesses) {
  std::chrono::nanoseconds most{0};
  for (const Guess& guess : guesses)
    most += 2 * static_cast<int>(few_stations(*guess.protocol).size()) *
            (kGuessTimeout + kGuessCharacters * with_line({}, guess.line).char_time);
  return most;
}

/// Prints the sections of a config for a device at `station`.
void print_found(const std::string& port, const Guess& guess, std::int64_t station) {
  const auto& [protocol, line] = guess;
  std::cout << "\"links\": [{\"name\": \"line1\", \"serial\": {\"path\": " << json_string(port)
            << ", \"baud\": " << line.baud << ", \"data_bits\": " << line.data_bits
            << ", \"parity\": " << json_string(parity_word(line.parity))
            << ", \"stop_bits\": " << line.stop_bits << "}}],\n"
            << "\"devices\": [{\"name\": \"plc1\", \"link\": \"line1\", \"protocol\": "
            << json_string(std::string(protocol->name));
  if (const std::string key(station_key(*protocol)); !key.empty())
    std::cout << ", " << json_string(key) << ": " << station;
  std::cout << "}]\n";
}

/// Asks at each station. True if one answers; its config is printed.
bool finds(LineProbe& probe, const std::string& port, const Guess& guess) {
  const std::string key(station_key(*guess.protocol));
  for (const std::int64_t station : few_stations(*guess.protocol)) {
    Options options = default_options(*guess.protocol);
    if (!key.empty()) options[key] = station;
    const auto codec = guess.protocol->make(options);
    if (!codec || !is_there(greet(probe, **codec, kGuessTimeout), **codec)) continue;
    print_found(port, guess, station);
    return true;
  }
  return false;
}

}  // namespace

int run_scan(const std::string& port) {
  log::set_level(log::Level::error);
  if (port.find('/') == port.npos && port.find(':') != port.npos)
    return refused(port, "scan takes only serial ports, such as /dev/ttyUSB0");
  if (const auto holder = port_holder(port))
    return refused(port, "another program uses it: " + holder->text() + "; end it first", kHeld);
  const std::vector<Guess> guesses = all_guesses();
  std::cerr << "Nothing is written to a device. At most "
            << std::chrono::duration_cast<std::chrono::minutes>(longest_time(guesses)).count() + 1
            << " minutes.\n";
  LinkConfig link;
  link.channel = SerialSettings{.path = port};
  for (const Guess& guess : guesses) {
    std::cerr << guess.protocol->name << " at " << to_string(guess.line) << '\n';
    LineProbe probe(with_line(link, guess.line));
    if (const auto opened = probe.open(); !opened) {
      const bool is_gone = ::access(port.c_str(), F_OK) != 0;
      if (is_gone || &guess == guesses.data()) return refused("", opened.error().text, kFailed);
      continue;  // the adapter lacks this speed
    }
    if (finds(probe, port, guess)) return kDone;
  }
  return refused(port, "nothing answers", kFailed);
}

}  // namespace fxagent
