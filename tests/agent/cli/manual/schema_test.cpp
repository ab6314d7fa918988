#include "agent/cli/manual/schema.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace fxagent {
namespace {

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
