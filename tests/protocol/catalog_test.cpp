#include "protocol/catalog.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "protocol/plc.h"

namespace fxagent {
namespace {

TEST(Catalog, FindsAProtocolByItsNameAndNothingByAnother) {
  const ProtocolInfo* info = find_protocol("fx-programming-port");
  ASSERT_NE(info, nullptr);
  EXPECT_EQ(info->line.baud, 9600);
  EXPECT_EQ(info->line.data_bits, 7);
  EXPECT_EQ(info->line.parity, Parity::even);
  EXPECT_FALSE(info->multidrop);
  EXPECT_EQ(info->models.back(), "FX3U");
  EXPECT_EQ(find_protocol("fx-programming"), nullptr);
}

TEST(Catalog, EveryEntryIsCompleteAndNamedOnce) {
  std::set<std::string_view> names;
  for (const ProtocolInfo& info : catalog()) {
    EXPECT_TRUE(names.insert(info.name).second) << info.name;
    EXPECT_FALSE(info.summary.empty());
    EXPECT_TRUE(info.on_serial || info.on_tcp);
    ASSERT_NE(info.make, nullptr);
    for (const OptionSpec& option : info.options) {
      EXPECT_FALSE(option.meaning.empty()) << option.key;
      if (option.kind == OptionSpec::Kind::choice) {
        const auto word = std::get<std::string_view>(option.fallback);
        EXPECT_NE(std::find(option.choices.begin(), option.choices.end(), word),
                  option.choices.end())
            << option.key;
      } else if (option.kind == OptionSpec::Kind::integer) {
        const auto number = std::get<std::int64_t>(option.fallback);
        EXPECT_TRUE(option.min <= number && number <= option.max) << option.key;
      }
    }
  }
}

TEST(Catalog, TheProgrammingPortIsMadeFromItsOptions) {
  const auto make = find_protocol("fx-programming-port")->make;
  const auto plain = make({{"model", std::string("auto")}});
  ASSERT_TRUE(plain);
  EXPECT_EQ(model_of(**plain), "");
  const auto known =
      make({{"model", std::string("FX2N")}, {"command_set", std::string("classic")}});
  ASSERT_TRUE(known);
  EXPECT_EQ(model_of(**known), "FX2N");
  EXPECT_FALSE(make({{"model", std::string("FX9")}}));
  const auto impossible =
      make({{"model", std::string("FX1S")}, {"command_set", std::string("extended")}});
  ASSERT_FALSE(impossible);
  EXPECT_EQ(impossible.error().text, "FX1S has only the classic command set");
  EXPECT_TRUE(make({{"model", std::string("auto")}, {"command_set", std::string("extended")}}));
  EXPECT_TRUE(make({}));
}

}  // namespace
}  // namespace fxagent
