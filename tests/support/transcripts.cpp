#include "tests/support/transcripts.h"

#include <gtest/gtest.h>

#include <charconv>
#include <fstream>

namespace fxagent::test {

std::vector<std::uint8_t> hex(std::string_view text) {
  std::string digits(text);
  std::erase(digits, ' ');
  EXPECT_EQ(digits.size() % 2, 0U) << text;
  std::vector<std::uint8_t> bytes(digits.size() / 2);
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    const char* const first = digits.data() + 2 * i;
    EXPECT_EQ(std::from_chars(first, first + 2, bytes[i], 16).ptr, first + 2) << text;
  }
  return bytes;
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
    } else if (line.starts_with("@ ")) {
      current.simulated = line.substr(2);
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
