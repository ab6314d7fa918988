// A working Modbus TCP device: only holding registers, with holes chosen by the test. Written from
// the specification alone (V1.1b3, 6.3 and 6.6).
#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "protocol/value/bytes.h"

namespace fxagent::test {

class FakeModbus final {
 public:
  std::map<unsigned, unsigned> registers;
  std::set<unsigned> lacks;
  unsigned longest = 125;
  std::map<unsigned, std::uint8_t> refuses;  ///< unit → exception for every request
  std::vector<std::string> asked;            ///< "1 read 10 2"

  Bytes answer(ByteView request) {
    if (request.size() < 12) return {};
    const unsigned unit = request[6];
    const unsigned function = request[7];
    const unsigned address = request[8] * 256U + request[9];
    const unsigned value = request[10] * 256U + request[11];
    const bool reads = function == 3;
    asked.push_back(std::to_string(unit) + (reads ? " read " : " write ") +
                    std::to_string(address) + " " + std::to_string(value));
    if (const auto refused = refuses.find(unit); refused != refuses.end())
      return exception(request, refused->second);
    if (!reads) {
      registers[address] = value;
      return framed(request, Bytes(request.begin() + 7, request.begin() + 12));
    }
    const auto hole = lacks.lower_bound(address);
    if (value > longest || (hole != lacks.end() && *hole < address + value))
      return exception(request, 2);
    Bytes pdu{3, static_cast<std::uint8_t>(2 * value)};
    for (unsigned i = 0; i < value; ++i) {
      pdu.push_back(static_cast<std::uint8_t>(registers[address + i] >> 8));
      pdu.push_back(static_cast<std::uint8_t>(registers[address + i]));
    }
    return framed(request, pdu);
  }

 private:
  static Bytes exception(ByteView request, std::uint8_t code) {
    return framed(request, {static_cast<std::uint8_t>(request[7] | 0x80), code});
  }
  static Bytes framed(ByteView request, const Bytes& pdu) {
    Bytes frame{request[0], request[1], 0, 0, 0, static_cast<std::uint8_t>(pdu.size() + 1),
                request[6]};
    frame.insert(frame.end(), pdu.begin(), pdu.end());
    return frame;
  }
};

}  // namespace fxagent::test
