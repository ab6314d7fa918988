// A working PLC on the programming port: memory behind the classic commands and the extended read.
// Its frames come from port_frames.h only. It records the requests in short form ("read 10C8 2",
// "E00 76B0 2").
#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "tests/agent/field/port_frames.h"

namespace fxagent::test {

class FakePort final {
 public:
  void set(unsigned address, const Bytes& bytes) {
    for (std::size_t i = 0; i < bytes.size(); ++i)
      memory_[address + static_cast<unsigned>(i)] = bytes[i];
  }
  unsigned word_at(unsigned address) { return memory_[address] + memory_[address + 1] * 256U; }

  /// Returns the answer to a whole frame; empty for anything else, and always while `silent`.
  Bytes answer(ByteView request) {
    const std::string text(request.begin(), request.end());
    if (request.size() == 1 && request[0] == kEnq[0]) {
      asked_.push_back("enq");
      return silent ? Bytes{} : kAck;
    }
    if (text.size() < 9 || text[0] != '\x02') return {};
    const std::string body = text.substr(2, text.size() - 5);
    Bytes reply;
    switch (text[1]) {
      case '0':
        reply = read("read ", number(body.substr(0, 4)), number(body.substr(4, 2)));
        break;
      case 'E':
        reply = read("E00 ", number(body.substr(2, 4)), number(body.substr(6, 2)));
        break;
      case '1':
        reply = write(number(body.substr(0, 4)), body.substr(6));
        break;
      default:
        asked_.push_back("other");
        reply = kNak;
    }
    return silent ? Bytes{} : reply;
  }

  const std::vector<std::string>& asked() const { return asked_; }
  std::size_t count(const std::string& what) const {
    return static_cast<std::size_t>(std::count(asked_.begin(), asked_.end(), what));
  }

  bool silent = false;

 private:
  static unsigned number(const std::string& hex) {
    return static_cast<unsigned>(std::stoul(hex, nullptr, 16));
  }
  Bytes read(const std::string& command, unsigned address, unsigned length) {
    asked_.push_back(command + hex_text(address, 4) + " " + std::to_string(length));
    Bytes bytes;
    for (unsigned i = 0; i < length; ++i) bytes.push_back(memory_[address + i]);
    return data_frame(bytes);
  }
  Bytes write(unsigned address, const std::string& data) {
    asked_.push_back("write " + hex_text(address, 4) + " " + data);
    for (unsigned i = 0; 2 * i < data.size(); ++i)
      memory_[address + i] = static_cast<std::uint8_t>(number(data.substr(2 * i, 2)));
    return kAck;
  }

  std::map<unsigned, std::uint8_t> memory_;
  std::vector<std::string> asked_;
};

}  // namespace fxagent::test
