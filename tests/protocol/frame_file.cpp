#include "tests/protocol/frame_file.h"

#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

namespace fxagent::test {

Bytes hex(std::string_view text) {
  const auto bytes = from_hex(text);
  EXPECT_TRUE(bytes.has_value()) << text;
  return bytes.value_or(Bytes{});
}

std::vector<Exchange> read_frames(const std::string& name) {
  std::ifstream file(std::string(FXAGENT_FRAMES_DIR) + "/" + name);
  EXPECT_TRUE(file.is_open()) << name;
  std::vector<Exchange> exchanges;
  Exchange current;
  std::string line;
  int number = 0;
  const auto finish = [&] {
    if (!current.request.empty()) exchanges.push_back(current);
    current = {};
  };
  while (std::getline(file, line)) {
    ++number;
    if (line.empty()) {
      finish();
    } else if (line.starts_with("# ")) {
      current.source = line.substr(2);
    } else if (line.starts_with(">> ")) {
      current.line = number;
      current.request = hex(line.substr(3));
    } else if (line.starts_with("<< ")) {
      current.reply = hex(line.substr(3));
    } else if (line.starts_with("= ")) {
      current.image = hex(line.substr(2));
    } else if (!line.starts_with("#")) {
      std::istringstream words(line);
      words >> current.model >> current.command_set >> current.operation >> current.device >>
          current.bytes;
      EXPECT_FALSE(words.fail()) << name << ":" << number;
    }
  }
  finish();
  return exchanges;
}

}  // namespace fxagent::test
