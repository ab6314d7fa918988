#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <iostream>
#include <vector>

#include "agent/cli/doctor/doctor.h"
#include "agent/cli/doctor/fixed_config.h"
#include "agent/cli/doctor/guesses.h"
#include "agent/cli/doctor/questions.h"
#include "agent/cli/exit_status.h"
#include "agent/field/line_probe.h"
#include "agent/log/log.h"
#include "agent/process/port_access.h"
#include "protocol/checklist.h"

namespace fxagent {
namespace {

// A guess has this many characters, request and answer together, at most; and greet() may ask
// twice.
constexpr int kGuessCharacters = 120;

}  // namespace

int run_scan(const std::string& port) {
  log::set_level(log::Level::error);
  if (const auto holder = port_holder(port))
    return refused(
        port,
        "another program uses it: " + holder->program + ", pid " + std::to_string(holder->pid),
        kHeld);
  struct Guess {
    const ProtocolInfo* protocol;
    LineDefaults line;
  };
  static constexpr std::size_t kFewStations = 4;
  std::vector<Guess> guesses;
  for (const ProtocolInfo& protocol : catalog())
    if (protocol.on_serial)
      for (const LineDefaults& line : line_guesses(protocol, protocol.line))
        guesses.push_back({&protocol, line});
  const auto stations_of = [](const ProtocolInfo& protocol) {
    const auto options = default_options(protocol);
    const auto* own = option<std::int64_t>(options, station_key(protocol));
    auto stations = station_guesses(protocol, own == nullptr ? 0 : *own);
    stations.resize(std::min(stations.size(), kFewStations));
    if (stations.empty()) stations.push_back(0);
    return stations;
  };
  std::chrono::nanoseconds most{0};
  for (const Guess& guess : guesses)
    most += 2 * static_cast<int>(stations_of(*guess.protocol).size()) *
            (kGuessTimeout + kGuessCharacters * with_line({}, guess.line).char_time);
  std::cerr << "Nothing is written to a device. At most "
            << std::chrono::duration_cast<std::chrono::minutes>(most).count() + 1 << " minutes.\n";
  for (const Guess& guess : guesses) {
    std::cerr << guess.protocol->name << " at " << to_string(guess.line) << '\n';
    LinkConfig link;
    link.channel = SerialSettings{.path = port};
    link = with_line(link, guess.line);
    LineProbe probe(link);
    if (const auto opened = probe.open(); !opened) {
      const bool is_gone = ::access(port.c_str(), F_OK) != 0;
      if (is_gone || &guess == guesses.data()) return refused("", opened.error().text, kFailed);
      continue;  // the adapter lacks this speed
    }
    const std::string key(station_key(*guess.protocol));
    for (const std::int64_t station : stations_of(*guess.protocol)) {
      Options options = default_options(*guess.protocol);
      if (!key.empty()) options[key] = station;
      const auto codec = guess.protocol->make(options);
      if (!codec || !is_there(greet(probe, **codec, kGuessTimeout), **codec)) continue;
      std::cout << "\"links\": [{\"name\": \"line1\", \"serial\": {\"path\": " << json_string(port)
                << ", \"baud\": " << guess.line.baud << ", \"data_bits\": " << guess.line.data_bits
                << ", \"parity\": " << json_string(word_of(guess.line.parity))
                << ", \"stop_bits\": " << guess.line.stop_bits << "}}],\n"
                << "\"devices\": [{\"name\": \"plc1\", \"link\": \"line1\", \"protocol\": "
                << json_string(std::string(guess.protocol->name));
      if (!key.empty()) std::cout << ", " << json_string(key) << ": " << station;
      std::cout << "}]\n";
      return kDone;
    }
  }
  return refused(port, "nothing answers", kFailed);
}

}  // namespace fxagent
