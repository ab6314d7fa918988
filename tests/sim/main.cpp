// fxsim: simulated Mitsubishi PLCs on pseudo terminals and TCP ports. For usage see
// docs/simulator.md. Exit status: 0 stopped on request, 1 a line could not be opened, 2 wrong usage
// or configuration.

#include <CLI/CLI.hpp>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>

#include "tests/sim/config.h"
#include "tests/sim/recorded.h"
#include "tests/sim/simulator.h"

namespace {

std::vector<fxsim::PlcConfig> load(const std::string& file, const std::vector<std::string>& forms,
                                   const std::string& from) {
  auto root = nlohmann::json{{"plcs", nlohmann::json::array()}};
  if (!file.empty()) {
    std::ifstream stream(file);
    if (!stream) throw fxsim::ConfigError(file + ": cannot be read");
    try {
      root = nlohmann::json::parse(stream);
    } catch (const nlohmann::json::parse_error& error) {
      throw fxsim::ConfigError(file + ": " + error.what());
    }
  }
  if (!root.is_object() || !root.contains("plcs") || !root["plcs"].is_array())
    throw fxsim::ConfigError("/plcs: an array of PLCs is expected");
  const std::size_t in_file = root["plcs"].size();
  for (const auto& form : forms) root["plcs"].push_back(fxsim::plc_from_short_form(form));
  if (root["plcs"].empty() && !from.empty()) return {};
  try {
    return fxsim::parse_config(root);
  } catch (const fxsim::ConfigError& error) {
    const std::string text = error.what();
    for (std::size_t i = 0; i < forms.size(); ++i) {
      const std::string place = "/plcs/" + std::to_string(in_file + i);
      if (text.starts_with(place + ':') || text.starts_with(place + '/'))
        throw fxsim::ConfigError("--plc " + forms[i] + (text[place.size()] == '/' ? ": " : "") +
                                 text.substr(place.size()));
    }
    throw;
  }
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Simulated Mitsubishi PLCs and Modbus devices on pseudo terminals, TCP and UDP ports"};
  app.set_version_flag("--version", std::string("fxsim ") + FXSIM_VERSION);
  std::string config;
  std::vector<std::string> forms;
  fxsim::Simulator::Options options;
  double seconds = 0;
  app.add_option("--config", config, "JSON file with the PLCs");
  app.add_option("--plc", forms,
                 "One more PLC: name=p1,model=FX3U,pty=/tmp/p1,baud=9600,plant=demo "
                 "(or tcp=PORT or udp=PORT, 0 for any free one)")
      ->expected(1)
      ->take_all();
  std::string from;
  std::string at;
  auto* from_option = app.add_option(
      "--from", from, "Recording of fxagent: answer each of its requests as it was answered");
  app.add_option("--at", at, "Where to play it: pty=PATH, tcp=PORT or udp=PORT")
      ->needs(from_option);
  std::string listen = "127.0.0.1";
  app.add_option("--listen", listen, "Address of the TCP and UDP ports (127.0.0.1); 0.0.0.0: all")
      ->check(CLI::ValidIPV4);
  app.add_option("--control", options.control, "Unix socket that takes one JSON object a line");
  app.add_option("--log", options.log, "File that gets one JSON object for each request");
  auto* limit = app.add_option("--seconds", seconds, "Stop after this many seconds")
                    ->check(CLI::PositiveNumber);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  try {
    auto plcs = load(config, forms, from);
    if (!from.empty()) {
      plcs.push_back(fxsim::recorded_plc(fxsim::read_recording(from), at));
      plcs.back().line_of = plcs.size() - 1;
    }
    for (auto& plc : plcs) plc.line.listen = listen;
    if (limit->count() > 0)
      options.lifetime = std::chrono::duration_cast<std::chrono::milliseconds>(
          std::chrono::duration<double>(seconds));
    options.signals = fxsim::Simulator::Signals::obeyed;
    fxsim::Simulator simulator(plcs, options);
    std::cout << simulator.ready_line() << std::endl;
    simulator.run();
    return 0;
  } catch (const fxsim::ConfigError& error) {
    std::cerr << "fxsim: " << error.what() << '\n';
    return 2;
  } catch (const std::exception& error) {
    std::cerr << "fxsim: " << error.what() << '\n';
    return 1;
  }
}
