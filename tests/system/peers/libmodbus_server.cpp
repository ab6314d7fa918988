// A Modbus server based on libmodbus: libmodbus_server tcp PORT | rtu TTY. Unit 1 has the same
// values as pymodbus_server.py. Prints "ready" once it serves, and serves until it is killed.
#include <modbus/modbus.h>

#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string_view>

namespace {

constexpr int kCount = 100;

void fill(modbus_mapping_t& map) {
  for (int n = 0; n < kCount; ++n) {
    map.tab_bits[n] = n % 3 == 0 ? 1 : 0;
    map.tab_input_bits[n] = n % 5 == 0 ? 1 : 0;
    map.tab_registers[n] = static_cast<std::uint16_t>(1000 + n);
    map.tab_input_registers[n] = static_cast<std::uint16_t>(2000 + n);
  }
}

/// Answers requests until the connection ends.
void serve(modbus_t* link, modbus_mapping_t* map) {
  std::uint8_t query[MODBUS_TCP_MAX_ADU_LENGTH];
  for (;;) {
    const int length = modbus_receive(link, query);
    if (length > 0)
      modbus_reply(link, query, length, map);
    else if (length == -1 && errno != EMBBADCRC && errno != ETIMEDOUT)
      return;
  }
}

}  // namespace

int main(int count, char** args) {
  if (count != 3) return 2;
  const bool tcp = std::string_view(args[1]) == "tcp";
  modbus_t* link = tcp ? modbus_new_tcp("127.0.0.1", std::atoi(args[2]))
                       : modbus_new_rtu(args[2], 115200, 'N', 8, 1);
  modbus_mapping_t* map = modbus_mapping_new(kCount, kCount, kCount, kCount);
  if (link == nullptr || map == nullptr) return 1;
  fill(*map);
  modbus_set_slave(link, 1);
  int listening = tcp ? modbus_tcp_listen(link, 1) : modbus_connect(link);
  if (listening == -1) return 1;
  std::puts("ready");
  std::fflush(stdout);
  while (!tcp || modbus_tcp_accept(link, &listening) != -1) serve(link, map);
  return 1;
}
