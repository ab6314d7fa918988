// Compares the generated files with what the program makes of its tables. config/generate.sh writes
// them anew.
#include "agent/cli/schema.h"

#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>

namespace fxagent {
namespace {

std::string text_of(const char* path) {
  std::ifstream file(path);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

TEST(Schema, TheFileIsWhatTheProgramPrints) {
  EXPECT_TRUE(text_of(FXAGENT_CONFIG_DIR "/agent.schema.json") == config_schema())
      << "run config/generate.sh";
}

TEST(Schema, ThePageHasTheTablesOfAllKeys) {
  std::istringstream page(text_of(FXAGENT_CONFIG_DIR "/README.md"));
  std::string found;
  std::string line;
  bool inside = false;
  while (std::getline(page, line)) {
    inside = line.starts_with("| key |") || (inside && line.starts_with("|"));
    if (inside) found += line + "\n";
  }
  EXPECT_EQ(found, config_tables()) << "run config/generate.sh";
}

TEST(Schema, EveryReferenceHasItsDefinitionAndEveryDefinitionAReference) {
  const std::string text = config_schema();
  const auto schema = nlohmann::json::parse(text);
  std::string left = text;
  for (const auto& [name, value] : schema.at("definitions").items()) {
    const std::string reference = "\"#/definitions/" + name + "\"";
    EXPECT_NE(text.find(reference), std::string::npos) << name;
    for (std::size_t at = left.find(reference); at != std::string::npos; at = left.find(reference))
      left.erase(at, reference.size());
  }
  EXPECT_EQ(left.find("#/definitions/"), std::string::npos) << left.substr(left.find("#/def"), 80);
}

}  // namespace
}  // namespace fxagent
