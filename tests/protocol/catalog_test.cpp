#include "protocol/catalog.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "protocol/checklist.h"
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
    EXPECT_FALSE(info.model_meaning.empty());
    ASSERT_TRUE(info.make);
    for (const OptionSpec& option : info.options) {
      EXPECT_FALSE(option.meaning.empty()) << option.key;
      if (option.kind == OptionSpec::Kind::choice) {
        const auto& word = std::get<std::string>(option.fallback);
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

TEST(Catalog, HintsNameTheToolThatSetsTheModelUp) {
  struct Hints {
    std::string silent;
    std::string closed;
  };
  const auto hints = [](std::string_view protocol, std::string_view model) {
    const ProtocolInfo* info = find_protocol(protocol);
    Options options = default_options(*info);
    options["model"] = std::string(model);
    const auto codec = *info->make(options);
    const Wiring wiring{Wiring::Channel::tcp, "192.0.2.10:5007", {}, false};
    return Hints{checklist(*info, options, *codec, wiring, Answers::none),
                 std::string(checklist_of_closed(*info, *codec))};
  };
  const auto names = [](std::string_view text, std::string_view tool) {
    return text.find(tool) != std::string_view::npos;
  };
  for (const char* protocol : {"mc-3e", "mc-4e"}) {
    for (const char* model : {"Q", "L"}) {
      const Hints found = hints(protocol, model);
      EXPECT_TRUE(names(found.silent, "GX Works2") && names(found.closed, "GX Works2")) << model;
      EXPECT_FALSE(names(found.silent, "Works3") || names(found.silent, "SLMP")) << found.silent;
      EXPECT_FALSE(names(found.closed, "Works3") || names(found.closed, "SLMP")) << found.closed;
    }
    for (const char* model : {"FX5U", "FX5UC", "FX5UJ", "FX5S", "iQ-R"}) {
      const Hints found = hints(protocol, model);
      EXPECT_TRUE(names(found.silent, "GX Works3") && names(found.closed, "SLMP")) << model;
      EXPECT_FALSE(names(found.silent, "Works2") || names(found.closed, "Works2")) << model;
    }
    const Hints open = hints(protocol, kAutoModel);
    EXPECT_TRUE(names(open.silent, "Works2") && names(open.silent, "Works3")) << open.silent;
    EXPECT_TRUE(names(open.closed, "Works2") && names(open.closed, "Works3")) << open.closed;
  }
  EXPECT_TRUE(names(hints("mc-1e", "Q").silent, "E71"));
  EXPECT_FALSE(names(hints("mc-1e", "Q").silent, "FX3U-ENET"));
  EXPECT_TRUE(names(hints("mc-1e", "FX3G").silent, "FX3U-ENET"));
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
