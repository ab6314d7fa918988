#include "agent/cli/setup/found_ports.h"

#include <algorithm>
#include <fstream>
#include <set>
#include <system_error>

namespace fxagent {
namespace {

namespace fs = std::filesystem;

std::vector<fs::path> sorted(const fs::path& directory) {
  std::error_code fault;
  std::vector<fs::path> paths;
  for (fs::directory_iterator it(directory, fault), end; !fault && it != end; it.increment(fault))
    paths.push_back(it->path());
  std::ranges::sort(paths);
  return paths;
}

/// True for a PC port without hardware. Linux has 32 such entries; the type of an unused one is 0.
bool is_empty_place(const fs::path& port) {
  std::ifstream file(port / "type");
  int kind = 1;
  return file >> kind && kind == 0;
}

}  // namespace

std::vector<FoundPort> found_serial_ports(const fs::path& root) {
  std::error_code fault;
  std::vector<FoundPort> ports;
  std::set<std::string> named;
  for (const fs::path& link : sorted(root / "dev/serial/by-id")) {
    const std::string port = fs::canonical(link, fault).filename().string();
    if (fault) continue;
    named.insert(port);
    ports.push_back({"/dev/serial/by-id/" + link.filename().string(), port});
  }
  for (const fs::path& port : sorted(root / "sys/class/tty")) {
    const std::string name = port.filename().string();
    const bool has_hardware = fs::exists(port / "device", fault) && !is_empty_place(port);
    if (has_hardware && !named.contains(name) && fs::exists(root / "dev" / name, fault))
      ports.push_back({"/dev/" + name, {}});
  }
  return ports;
}

}  // namespace fxagent
