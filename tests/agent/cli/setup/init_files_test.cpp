// The files of a new plant, for every protocol in the catalogue.
#include "agent/cli/setup/init_files.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <regex>

#include "agent/config/loader.h"
#include "tests/support/says.h"

namespace fxagent {
namespace {

using nlohmann::json;
using test::expect_says;

InitAnswers answers_for(const ProtocolInfo& protocol) {
  InitAnswers answers;
  answers.id = "edge7";
  answers.broker = "mqtt://broker.example";
  answers.protocol = protocol.name;
  answers.port = protocol.on_serial ? "/dev/ttyUSB0" : "192.0.2.7:502";
  const std::string address(example_address(protocol));
  answers.read = {address, "second=" + address};
  answers.write = {"level=" + address};
  return answers;
}

std::map<std::string, std::string> made(const InitAnswers& answers) {
  const auto files = init_files(answers, "/etc/fxagent");
  EXPECT_TRUE(files) << (files ? "" : files.error());
  std::map<std::string, std::string> texts;
  if (files)
    for (const InitFile& file : *files) texts[file.name] = file.text;
  return texts;
}

TEST(InitFiles, FitEachOtherForEveryProtocol) {
  for (const ProtocolInfo& protocol : catalog()) {
    const auto files = made(answers_for(protocol));
    ASSERT_EQ(files.size(), init_file_names().size()) << protocol.name;
    const auto config = parse_config(files.at("agent.json"));
    ASSERT_TRUE(config) << protocol.name << to_string(config.error().front(), "agent.json");
    ASSERT_EQ(config->devices.size(), 1U);
    const DeviceConfig& device = config->devices[0];
    EXPECT_EQ(device.protocol, &protocol);
    EXPECT_EQ(device.tags.size(), 3U);
    EXPECT_FALSE(device.tags[0].writable);
    EXPECT_TRUE(device.tags[2].writable);
    const std::string base = config->base_topic();
    expect_says(files.at("fxagent.acl"), "user edge7\ntopic write " + base + "/state\n");
    expect_says(files.at("fxagent.acl"), "user nodered\n");
    expect_says(files.at("fxagent.service.d.conf"), "run /etc/fxagent/agent.json\n");

    const json flow = json::parse(files.at("node-red-flow.json"));
    std::set<std::string> ids;
    std::set<std::string> topics;
    for (const json& node : flow) {
      EXPECT_TRUE(ids.insert(node.at("id")).second);
      if (node.contains("topic")) topics.insert(node.at("topic"));
    }
    EXPECT_EQ(topics, (std::set<std::string>{base + "/+/data/+", base + "/+/state",
                                             base + "/+/result", base + "/plc1/command"}));
    for (const json& node : flow)
      for (const json& wire : node.value("wires", json::array()))
        for (const json& to : wire) EXPECT_TRUE(ids.contains(to)) << to;
    EXPECT_EQ(flow[0].at("label"), "fxagent edge7");
    EXPECT_FALSE(std::regex_search(files.at("node-red-flow.json"), std::regex("\\{[a-z_]+\\}")));
    EXPECT_EQ(flow[1].at("broker"), "broker.example");
    EXPECT_EQ(flow[1].at("usetls"), false);
    EXPECT_EQ(flow[1].at("port"), "1883");
  }
}

TEST(InitFiles, OnlyWhoGivesAUserOrAPasswordGetsThemIntoTheConfig) {
  const auto mqtt_for = [](const std::string& user, const std::string& password_file) {
    InitAnswers answers = answers_for(*find_protocol("modbus-rtu"));
    answers.user = user;
    answers.password_file = password_file;
    return json::parse(made(answers).at("agent.json"))["mqtt"];
  };
  json expected = {{"servers", {"mqtt://broker.example"}}};
  EXPECT_EQ(mqtt_for("", ""), expected);
  expected["username"] = "anna";
  expected["password_file"] = "mqtt_password";
  EXPECT_EQ(mqtt_for("anna", ""), expected);
  expected["username"] = "edge7";
  expected["password_file"] = "/run/secrets/broker";
  EXPECT_EQ(mqtt_for("", "/run/secrets/broker"), expected);
}

TEST(InitFiles, UnitAndStationGoWhereTheProtocolHasThem) {
  for (const ProtocolInfo& protocol : catalog()) {
    InitAnswers answers = answers_for(protocol);
    answers.unit = "5";
    const json device = json::parse(made(answers).at("agent.json"))["devices"][0];
    for (const char* key : {"unit", "station"}) {
      const bool has =
          std::ranges::find(protocol.options, key, &OptionSpec::key) != protocol.options.end();
      EXPECT_EQ(device.contains(key), has) << protocol.name;
      if (has) {
        EXPECT_EQ(device[key], 5);
      }
    }
  }
}

TEST(InitFiles, TheDropInKnowsThePort) {
  InitAnswers answers = answers_for(*find_protocol("modbus-rtu"));
  EXPECT_EQ(made(answers).at("fxagent.service.d.conf").find("DeviceAllow"), std::string::npos);
  answers.port = "/dev/moxa0";
  expect_says(made(answers).at("fxagent.service.d.conf"), "DeviceAllow=/dev/moxa0 rw\n");
  answers.port = "192.0.2.1:4001";
  expect_says(made(answers).at("fxagent.service.d.conf"), "PrivateDevices=yes\n");
}

TEST(InitFiles, TheUnitReadsItsConfigWhereItsUserCan) {
  const InitAnswers answers = answers_for(*find_protocol("modbus-rtu"));
  const auto files = init_files(answers, "/home/anna/plant");
  ASSERT_TRUE(files);
  const std::string& text = files->at(2).text;
  EXPECT_NE(text.find("ExecStart=/usr/bin/fxagent run /etc/fxagent/agent.json\n"), text.npos)
      << text;
  EXPECT_NE(
      text.find("#   install -D -m 644 /home/anna/plant/agent.json /etc/fxagent/agent.json\n"),
      text.npos)
      << text;
  EXPECT_EQ(made(answers).at("fxagent.service.d.conf").find("agent.json /etc"), text.npos);
  EXPECT_EQ(text.find("mqtt_password"), text.npos);
  InitAnswers with_user = answers;
  with_user.user = "edge7";
  expect_says(init_files(with_user, "/home/anna/plant")->at(2).text,
              "#   install -D -m 600 -o fxagent /home/anna/plant/mqtt_password "
              "/etc/fxagent/mqtt_password\n");
  EXPECT_EQ(made(with_user).at("fxagent.service.d.conf").find("mqtt_password"), text.npos);
  with_user.password_file = "/etc/secret";
  EXPECT_EQ(init_files(with_user, "/home/anna/plant")->at(2).text.find("secret"), text.npos);
}

TEST(InitFiles, TheSetPointHasTheTypeOfItsTag) {
  InitAnswers answers = answers_for(*find_protocol("modbus-rtu"));
  for (const auto& [address, payload, type] :
       {std::tuple{"on=co:1", "true", "bool"}, std::tuple{"on=hr:1", "0", "num"}}) {
    answers.write = {address};
    const json flow = json::parse(made(answers).at("node-red-flow.json"));
    const json& inject = flow[flow.size() - 3];
    EXPECT_EQ(inject.at("name"), "set on");
    EXPECT_EQ(inject.at("payload"), payload);
    EXPECT_EQ(inject.at("payloadType"), type);
  }
}

TEST(InitFiles, WithoutASetPointTheFlowSendsNothing) {
  InitAnswers answers = answers_for(*find_protocol("fx-programming-port"));
  answers.write.clear();
  EXPECT_EQ(made(answers).at("node-red-flow.json").find("mqtt out"), std::string::npos);
}

TEST(InitFiles, WrongAnswersAreErrors) {
  const auto error_of = [](auto spoil) {
    InitAnswers answers = answers_for(*find_protocol("fx-programming-port"));
    spoil(answers);
    const auto files = init_files(answers, "/tmp");
    return files ? std::string() : files.error();
  };
  expect_says(error_of([](InitAnswers& a) { a.port = "COM1"; }), "--port");
  expect_says(error_of([](InitAnswers& a) { a.unit = "x"; }), "--unit");
  expect_says(error_of([](InitAnswers& a) { a.broker = "tcp://a"; }), "--broker: must begin");
  expect_says(error_of([](InitAnswers& a) { a.protocol = "s7"; }), "--protocol: must be");
  expect_says(error_of([](InitAnswers& a) { a.read = {"X8"}; }), "--read X8: ");
  expect_says(error_of([](InitAnswers& a) { a.write = {"b=X8"}; }), "--write b=X8: ");
  const std::string all = error_of([](InitAnswers& a) {
    a.broker = "tcp://a";
    a.port = "COM1";
    a.unit = "x";
    a.model = "S7";
  });
  for (const char* flag : {"--broker: ", "--port ", "--unit ", "--model: "})
    EXPECT_NE(all.find(flag), std::string::npos) << flag << all;
  expect_says(error_of([](InitAnswers& a) { a.operator_name = "edge7"; }), "named twice");
}

}  // namespace
}  // namespace fxagent
