#include "agent/remote/desired_config.h"
#include "agent/config/loader.h"
#include "agent/config/read/findings.h"

#include <gtest/gtest.h>

#include <random>

#include "tests/agent/remote/remote_plant.h"

namespace fxagent {
namespace {

using namespace test;

// ---- the document -------------------------------------------------------------------------------

TEST(DesiredConfig, ConfigOrPatchWithAVersionIsRead) {
  const std::string text = R"({"version": "v7", "by": "ann", "patch": {}})";
  const auto [desired, errors] = read_desired(text);
  EXPECT_TRUE(errors.empty()) << listed(errors);
  EXPECT_EQ(desired.version, "v7");
  EXPECT_EQ(desired.by, "ann");
  EXPECT_EQ(desired.text, text);
  // From: sha256sum | cut -c1-16
  EXPECT_EQ(desired.hash, "2dabccfd753b3d60");
}

struct Wrong {
  const char* name;
  std::string text;
  std::vector<const char*> said;
};

TEST(DesiredConfig, EverythingWrongIsSaidAtOnce) {
  for (const Wrong& each : std::vector<Wrong>{
           {"empty object", "{}", {"\"version\" is missing", "needs \"config\" or \"patch\""}},
           {"no object", "[]", {"must be an object"}},
           {"no JSON", R"({"version": "1",)", {"not JSON at line 1"}},
           {"comment", R"({"version": "1", "patch": {}} // all)", {"column 31: a comment"}},
           {"a number", R"({"version": 7, "patch": {}})", {"/version: must be a string"}},
           {"null", R"({"version": null, "patch": {}})", {"/version: must be a string"}},
           {"empty", R"({"version": "", "patch": {}})", {"/version: must be a string of 1"}},
           {"long",
            R"({"version": ")" + std::string(65, 'v') + R"(", "patch": {}})",
            {"/version: must be a string of 1 to 64"}},
           {"control", R"({"version": "a\nb", "patch": {}})", {"control characters"}},
           {"both",
            R"({"version": "1", "config": {}, "patch": {}})",
            {"has both \"config\" and \"patch\""}},
           {"neither", R"({"version": "1"})", {"needs \"config\" or \"patch\""}},
           {"shapes", R"({"version": "1", "config": []})", {"/config: must be an object"}},
           {"null patch", R"({"version": "1", "patch": null})", {"/patch: must be an object"}},
           {"unknown",
            R"({"version": "1", "patch": {}, "pach": {}})",
            {"unknown key \"pach\"; did you mean patch?"}},
           {"twice", R"({"version": "1", "version": "2", "patch": {}})", {"duplicate key"}},
           {"twice below",
            R"({"version": "1", "config": {"devices": [{"name": "a", "name": "b"}]}})",
            {"/devices/0/name: duplicate key"}},
           {"by", R"({"version": "1", "patch": {}, "by": 3})", {"/by: must be a string"}},
           {"many",
            R"({"version": 1, "config": 2, "x": 3})",
            {"/version", "/config", "unknown key \"x\""}},
           {"zero byte", std::string("{\0}", 3), {"a zero byte"}},
           {"no UTF-8", "{\"version\": \"\xff\", \"patch\": {}}", {"not JSON"}},
       }) {
    const auto [desired, errors] = read_desired(each.text);
    EXPECT_EQ(errors.size(), each.said.size()) << each.name << "\n" << listed(errors);
    for (const char* said : each.said)
      EXPECT_NE(listed(errors).find(said), std::string::npos)
          << each.name << ": " << said << " in\n"
          << listed(errors);
    EXPECT_EQ(desired.text, "") << each.name;
    EXPECT_EQ(desired.hash.size(), 16u) << each.name;
  }
}

TEST(DesiredConfig, SizeAndDepthHaveLimits) {
  std::string deep = R"({"version": "1", "patch": {"a": )";
  deep += std::string(100'000, '[');
  EXPECT_NE(listed(read_desired(deep).errors).find("32 levels"), std::string::npos);
  const std::string large(kMaxDesiredBytes + 1, ' ');
  EXPECT_EQ(listed(read_desired(large).errors), "agent.json: larger than 1 MiB\n");
  EXPECT_NE(listed(read_desired(large.substr(1)).errors).find("not JSON"), std::string::npos);
}

TEST(DesiredConfig, AWrongVersionDoesNotHideTheOther) {
  EXPECT_EQ(read_desired(R"({"version": "v3", "config": 1})").desired.version, "v3");
}

// ---- the merge with the local file -------------------------------------------------------------

TEST(MergedConfig, SectionsTakeThePlaceOfTheLocalOnes) {
  json device = local_plant()["devices"][1];
  device["name"] = "other";
  const auto config = effective(local_plant(), config_of({{"devices", {device}}}));
  ASSERT_TRUE(config.has_value()) << listed(config.error());
  ASSERT_EQ(config->devices.size(), 1u);
  EXPECT_EQ(config->devices[0].name, "other");
  EXPECT_EQ(config->links.size(), 2u);  // the local ones
  EXPECT_EQ(config->mqtt.password, "s3cret");
}

TEST(MergedConfig, APatchIsMergedOntoTheLocalFile) {
  json local = local_plant();
  local["templates"]["mixer"] = {{"protocol", "fx-programming-port"}, {"model", "FX2N"}};
  local["devices"][1] = {{"name", "mixer"}, {"link", "gw1"}, {"template", "mixer"}};
  const auto patched = effective(local, patch_of({{"templates", {{"mixer", {{"retries", 5}}}}}}));
  ASSERT_TRUE(patched.has_value()) << listed(patched.error());
  EXPECT_EQ(patched->devices[1].retries, 5);
  EXPECT_EQ(patched->devices[0].tags.size(), 3u);
  const auto none = effective(local, patch_of(json::object()));
  ASSERT_TRUE(none.has_value());
  EXPECT_EQ(none->devices[1].retries, 2);
}

/// RFC 7396, appendix A. Applied to a section, because the document is an object of sections.
TEST(MergedConfig, PatchesAreThoseOfTheRfc) {
  struct Case {
    const char* original;
    const char* patch;
    const char* result;
  };
  for (const Case& each : std::vector<Case>{
           {R"({"a":"b"})", R"({"a":"c"})", R"({"a":"c"})"},
           {R"({"a":"b"})", R"({"b":"c"})", R"({"a":"b","b":"c"})"},
           {R"({"a":"b"})", R"({"a":null})", R"({})"},
           {R"({"a":"b","b":"c"})", R"({"a":null})", R"({"b":"c"})"},
           {R"({"a":["b"]})", R"({"a":"c"})", R"({"a":"c"})"},
           {R"({"a":"c"})", R"({"a":["b"]})", R"({"a":["b"]})"},
           {R"({"a":{"b":"c"}})", R"({"a":{"b":"d","c":null}})", R"({"a":{"b":"d"}})"},
           {R"({"a":[{"b":"c"}]})", R"({"a":[1]})", R"({"a":[1]})"},
           {R"(["a","b"])", R"(["c","d"])", R"(["c","d"])"},
           {R"({"a":"b"})", R"(["c"])", R"(["c"])"},
           {R"({"e":null})", R"({"a":1})", R"({"a":1,"e":null})"},
           {R"([1,2])", R"({"a":"b","c":null})", R"({"a":"b"})"},
           {R"({})", R"({"a":{"bb":{"ccc":null}}})", R"({"a":{"bb":{}}})"},
       }) {
    const json local{{"templates", json::parse(each.original)}};
    const auto desired = patch_of({{"templates", json::parse(each.patch)}});
    std::string merged;
    const auto parse = [&](std::string_view text) {
      merged = text;
      return Config();
    };
    EXPECT_TRUE(effective_config(local.dump() + " // local", Config(), desired, parse));
    EXPECT_EQ(json::parse(merged)["templates"], json::parse(each.result)) << each.patch;
  }
}

TEST(MergedConfig, WhatMayNotComeIsAnErrorThatNamesTheSection) {
  struct Case {
    json config;
    const char* pointer;
    const char* text;
  };
  const json all{"links", "devices", "mqtt.servers", "commands.allow_run_stop"};
  for (const Case& each : std::vector<Case>{
           {{{"agent", {{"id", "other"}}}}, "/agent", "cannot be set remotely"},
           {{{"agent", {{"id", "edge7"}, {"remote_allow", {"links"}}}}}, "/agent", "restart"},
           {{{"store", {{"path", "/tmp"}}}}, "/store", "cannot be set remotely"},
           {{{"metrics", {{"listen", "0.0.0.0:1"}}}}, "/metrics", "cannot be set remotely"},
           {{{"links_", json::array()}}, "/links_", "is not a section of a config"},
           {{{"a/b~c", json::array()}}, "/a~1b~0c", "is not a section of a config"},
           {{{"mqtt", 5}}, "/mqtt", "must be an object"},
           {{{"mqtt", {{"qos", 0}}}}, "/mqtt/qos", "of mqtt only servers"},
           {{{"mqtt", {{"client_id", "x"}}}}, "/mqtt/client_id", "of mqtt only servers"},
           {{{"mqtt", {{"tls", json::object()}}}}, "/mqtt/tls", "cannot be set remotely"},
           {{{"mqtt", {{"password_file", "/etc/shadow"}}}},
            "/mqtt/password_file",
            "cannot be set remotely"},
           {{{"mqtt", {{"username", "root"}}}}, "/mqtt/username", "cannot be set remotely"},
       }) {
    expect_error(errors_of(local_plant(all), config_of(each.config)), each.pointer, {each.text});
    expect_error(errors_of(local_plant(all), patch_of(each.config)), each.pointer, {each.text});
  }
  const json none = json::array();
  for (const char* section : {"links", "devices", "templates"}) {
    json change = {{section, section == std::string("templates") ? json::object() : none}};
    if (section == std::string("templates")) change[section]["t"] = json::object();
    const auto errors = errors_of(local_plant(none), config_of(change));
    expect_error(errors, std::string("/") + section, {"remote_allow"});
  }
  expect_error(errors_of(local_plant(), config_of({{"mqtt", {{"servers", {"mqtt://elsewhere"}}}}})),
               "/mqtt/servers", {"does not have \"mqtt.servers\""});
}

TEST(MergedConfig, WhatIsAsInTheLocalFileMayStandThere) {
  json whole = local_plant(json{"devices"});
  json config = whole;
  for (const char* secret : {"username", "password", "allow_plain_secret"})
    config["mqtt"].erase(secret);
  config["devices"][0]["retries"] = 7;
  config["$schema"] = "https://example.org/agent.schema.json";
  const auto merged = effective(whole, config_of(config));
  ASSERT_TRUE(merged.has_value()) << listed(merged.error());
  EXPECT_EQ(merged->devices[0].retries, 7);
  EXPECT_EQ(merged->mqtt.username, "edge7");
}

/// A sender must not learn from the refusal that a guessed password was right.
TEST(MergedConfig, TheRightPasswordIsRefusedLikeAWrongOne) {
  const auto said = [](const char* guess) {
    return listed(errors_of(local_plant(), config_of({{"mqtt", {{"password", guess}}}})));
  };
  EXPECT_EQ(said("s3cret"), said("wrong"));
  EXPECT_NE(said("wrong"), "");
  const auto removed = patch_of({{"mqtt", {{"password", nullptr}}}});
  EXPECT_NE(listed(errors_of(local_plant(), removed)), "");
}

TEST(MergedConfig, NoVariableIsReadInARemoteConfig) {
  json link = {{"name", "gw1"}, {"tcp", {{"host", "${HOST}"}, {"port", 1}}}};
  expect_error(errors_of(local_plant(), config_of({{"links", {local_plant()["links"][0], link}}})),
               "/links/1/tcp/host", {"environment variable"});
  json tag = {{"name", "a"}, {"address", "D1"}, {"unit", "a ${MQTT_PASSWORD} b"}};
  json device = local_plant()["devices"][0];
  device["tags"] = json::array({tag});
  expect_error(
      errors_of(local_plant(), config_of({{"devices", {device, local_plant()["devices"][1]}}})),
      "/devices/0/tags/0/unit", {"environment variable"});
  device["tags"][0]["unit"] = "$${plain}";
  const auto plain =
      effective(local_plant(), config_of({{"devices", {device, local_plant()["devices"][1]}}}));
  ASSERT_TRUE(plain.has_value()) << listed(plain.error());
  EXPECT_EQ(plain->devices[0].tags[0].units->unit, "${plain}");
}

/// The text that stands in for the variable is no address, type or host: that is no second error.
TEST(MergedConfig, AVariableIsTheOnlyErrorOfItsPlace) {
  const std::string variable = "${HOME}";
  for (const char* key : {"address", "type", "name", "access", "scale"}) {
    json device = local_plant()["devices"][0];
    device["tags"] = json::array({{{"name", "a"}, {"address", "D1"}}});
    device["tags"][0][key] = variable;
    const auto errors =
        errors_of(local_plant(), config_of({{"devices", {device, local_plant()["devices"][1]}}}));
    ASSERT_EQ(errors.size(), 1u) << key << "\n" << listed(errors);
    EXPECT_EQ(errors[0].pointer, std::string("/devices/0/tags/0/") + key);
  }
  for (const char* key : {"name", "link", "protocol"}) {
    json device = local_plant()["devices"][0];
    device[key] = variable;
    const auto errors =
        errors_of(local_plant(), config_of({{"devices", {device, local_plant()["devices"][1]}}}));
    ASSERT_EQ(errors.size(), 1u) << key << "\n" << listed(errors);
    EXPECT_EQ(errors[0].pointer, std::string("/devices/0/") + key);
  }
  json links = local_plant()["links"];
  links[1]["tcp"]["host"] = variable;  // the device there is new, and has no rights
  const auto errors = errors_of(local_plant(), config_of({{"links", links}}));
  ASSERT_EQ(errors.size(), 1u) << listed(errors);
  EXPECT_EQ(errors[0].pointer, "/links/1/tcp/host");
}

TEST(MergedConfig, AVariableAsANameOfALinkIsNoUnknownLink) {
  json links = local_plant()["links"];
  links[0]["name"] = "${HOME}";
  expect_error(errors_of(local_plant(), config_of({{"links", links}})), "/links/0/name",
               {"environment variable"});
}

TEST(MergedConfig, VariablesAreCountedOnceAmongTheErrorsThatAreNotListed) {
  json device = local_plant()["devices"][0];
  device["tags"] = json::array();
  for (std::size_t i = 0; i < Findings::kMost + 500; ++i)
    device["tags"].push_back({{"name", "t" + std::to_string(i)}, {"address", "${HOME}"}});
  const auto count = [&] {
    return errors_of(local_plant(), config_of({{"devices", {device, local_plant()["devices"][1]}}}))
        .front()
        .unlisted;
  };
  EXPECT_EQ(count(), 500U);
  for (std::size_t i = 1; i < device["tags"].size(); ++i) device["tags"][i]["address"] = "D1G";
  EXPECT_EQ(count(), 500U);
}

TEST(MergedConfig, AnUnknownKeyWithAVariableIsBothErrors) {
  json device = local_plant()["devices"][0];
  device["tags"] = json::array({{{"name", "a"}, {"address", "D1"}, {"colour", "${HOME}"}}});
  const auto errors =
      errors_of(local_plant(), config_of({{"devices", {device, local_plant()["devices"][1]}}}));
  ASSERT_EQ(errors.size(), 2u) << listed(errors);
  for (const ConfigError& error : errors) EXPECT_EQ(error.pointer, "/devices/0/tags/0/colour");
  EXPECT_NE(errors[0].text.find("environment variable"), std::string::npos);
  EXPECT_NE(errors[1].text.find("unknown key \"colour\""), std::string::npos);
}

TEST(MergedConfig, ControlCharactersInAKeyAreEscaped) {
  json device = local_plant()["devices"][0];
  device["a\x1B[2J"] = "${HOME}";
  for (const json& sections :
       {json{{"devices", {device, local_plant()["devices"][1]}}}, json{{"new\nsection", 1}}}) {
    const std::string text = listed(errors_of(local_plant(), config_of(sections)));
    EXPECT_EQ(text.find('\x1B'), std::string::npos) << text;
    EXPECT_EQ(text.find("new\n"), std::string::npos) << text;
    EXPECT_TRUE(text.find("/devices/0/a\\x1B[2J: a remote") != std::string::npos ||
                text.find("/new\\x0Asection: ") != std::string::npos)
        << text;
  }
}

TEST(MergedConfig, OtherErrorsStandNextToAVariable) {
  json device = local_plant()["devices"][0];
  device["tags"] = json::array({{{"name", "a"}, {"address", "${HOME}"}, {"type", "int17"}}});
  const auto errors =
      errors_of(local_plant(), config_of({{"devices", {device, local_plant()["devices"][1]}}}));
  ASSERT_EQ(errors.size(), 2u) << listed(errors);
  EXPECT_EQ(errors[0].pointer, "/devices/0/tags/0/address");
  EXPECT_EQ(errors[1].pointer, "/devices/0/tags/0/type");
}

TEST(MergedConfig, TheLocalFilesOwnVariablesStay) {
  json local = local_plant();
  local["links"][1]["tcp"]["host"] = "${HOST}";
  const std::string text = local.dump();
  const auto from = environment({{"HOST", "inner"}});
  const auto config =
      effective_config(text, good(text, from), patch_of({{"templates", json::object()}}),
                       [&](std::string_view merged) { return parse_config(merged, from); });
  ASSERT_TRUE(config.has_value()) << listed(config.error());
  EXPECT_EQ(std::get<TcpSettings>(config->links[1].channel).host, "inner");
}

TEST(MergedConfig, ErrorsOfTheConfigComeBesideThoseOfTheLimits) {
  json devices = local_plant()["devices"];
  devices[0]["tags"][0]["address"] = "X8";
  devices[1]["timeut_ms"] = 3;
  const auto errors =
      errors_of(local_plant(), config_of({{"devices", devices}, {"store", nullptr}, {"agent", 1}}));
  const std::string said = listed(errors);
  EXPECT_EQ(errors.size(), 4u) << said;
  for (const char* each : {"/store: ", "/agent: ", "/devices/0/tags/0/address: ", "timeut_ms"})
    EXPECT_NE(said.find(each), std::string::npos) << each << " in\n" << said;
  EXPECT_EQ(said.find("(line"), std::string::npos) << said;
  for (const ConfigError& error : errors) EXPECT_EQ(error.line, 0);
}

/// No secret of the local file appears in an error, whatever the document contains.
TEST(MergedConfig, NoErrorHasASecret) {
  std::mt19937 random(7);
  const std::vector<json> values{"s3cret",       nullptr,          5,  json::array(),
                                 json::object(), json{"mqtt://x"}, "x"};
  const std::vector<std::string> places{"/mqtt",           "/mqtt/password", "/mqtt/servers",
                                        "/mqtt/servers/0", "/links",         "/links/0/name",
                                        "/devices/0/link", "/agent/id",      "/mqtt/username"};
  for (int i = 0; i < 300; ++i) {
    json config = local_plant();
    config["mqtt"].erase("password");
    for (int change = 0; change < 2; ++change) try {
        config[json::json_pointer(places[random() % places.size()])] =
            values[random() % values.size()];
      } catch (const json::exception&) {  // removed by the previous change
      }
    json named = config;
    const bool says_it = named.dump().find("s3cret") != std::string::npos;
    const auto errors =
        errors_of(local_plant(json{"links", "devices", "mqtt.servers"}), config_of(config));
    if (!says_it) {
      EXPECT_EQ(listed(errors).find("s3cret"), std::string::npos) << listed(errors);
    }
  }
}

}  // namespace
}  // namespace fxagent
