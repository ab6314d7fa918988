#include "agent/cli/report/plan_report.h"
#include "agent/config/loader.h"

#include <gtest/gtest.h>

namespace fxagent {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;

double ms(nanoseconds duration) {
  return std::chrono::duration<double, std::milli>(duration).count();
}

Config config_of(const std::string& link, const std::string& device) {
  const std::string text =
      R"({"agent":{"id":"e","root":"r"},"mqtt":{"servers":["mqtt://127.0.0.1:1883"]},"links":[)" +
      link + R"(],"devices":[)" + device + "]}";
  auto config = parse_config(text);
  EXPECT_TRUE(config.has_value()) << (config ? "" : config.error().front().text);
  return config ? *config : Config{};
}

const std::string kSerial = R"({"name":"l","serial":{"path":"/dev/x","baud":9600}})";

std::string plc(const std::string& tags, const std::string& more = "") {
  return R"({"name":"p","link":"l","protocol":"fx-programming-port","model":"FX3U","turnaround_ms":0,)"
         R"("groups":[{"name":"g","interval_ms":1000}],"tags":[)" +
         tags + "]" + more + "}";
}

/// 100 D and 64 M in one group, as two arrays.
const std::string kLarge = R"({"name":"d","address":"D0","count":100,"group":"g"},
                              {"name":"m","address":"M0","count":64,"group":"g"})";

TEST(PlanReport, LeastLineTimeIsThatOfTheCharactersCounted) {
  const auto links = plan_links(config_of(kSerial, plc(kLarge)));
  ASSERT_EQ(links.size(), 1U);
  ASSERT_EQ(links[0].groups.size(), 1U);
  const GroupLoad& group = links[0].groups[0];
  // 64, 64, 64 and 8 bytes of D, 8 bytes of M: five times 11 + 4 characters, plus two for each
  // byte.
  ASSERT_TRUE(group.line_time);
  EXPECT_NEAR(ms(*group.line_time), 511.5, 0.1);
  EXPECT_EQ(group.exchanges.size(), 5U);
  for (const ExchangeReport& exchange : group.exchanges)
    EXPECT_NEAR(ms(*exchange.line_time), (15 + 2 * exchange.bytes()) * 10 / 9.6, 0.01)
        << exchange.addresses.front();
  EXPECT_NEAR(ms(group.use.framing), 5 * 15 * 10 / 9.6, 0.1);
  EXPECT_NEAR(ms(group.use.unasked), 0, 0.01);
  EXPECT_EQ(group.use.turnaround.count(), 0);
}

/// Returns the line time of the only exchange of a device with this one tag.
double only_exchange(const std::string& protocol, const std::string& tag) {
  const auto links = plan_links(config_of(
      kSerial, R"({"name":"p","link":"l","turnaround_ms":0,"groups":[{"name":"g"}],"protocol":")" +
                   protocol + R"(","tags":[{"name":"t","group":"g",)" + tag + "}]}"));
  EXPECT_EQ(links[0].groups[0].exchanges.size(), 1U);
  return ms(*links[0].groups[0].exchanges[0].line_time);
}

// Frames as printed in the protocols' documents, counted by hand; 9600 baud.
TEST(PlanReport, TimesOfProgrammingPortReadsAreThoseOfTheirFrames) {
  const std::string port = R"(fx-programming-port","model":"FX3U)";
  // D123-D124: 02 30 31 30 46 36 30 34 03 37 34, and back 02, 8 digits, 03, sum: 11 + 12 of 10
  // bits.
  EXPECT_NEAR(only_exchange(port, R"("address":"D123","type":"int32")"), 23 * 10 / 9.6, 0.001);
  // Y0-Y17: 02 30 30 30 41 30 30 32 03 36 36, and back 02, 4 digits, 03, sum: 11 + 8.
  EXPECT_NEAR(only_exchange(port, R"("address":"Y0","count":16)"), 19 * 10 / 9.6, 0.001);
  // One word past D1023: 02 45 30 30, address, 30 32 03, sum, and back as above: 13 + 8.
  EXPECT_NEAR(only_exchange(port, R"("address":"D5000")"), 21 * 10 / 9.6, 0.001);
  // 64 bytes: 11 out; 02, 128 digits, 03, sum back.
  EXPECT_NEAR(only_exchange(port, R"("address":"D0","count":32)"), 143 * 10 / 9.6, 0.001);
}

TEST(PlanReport, TimesOfTheOtherProtocolsAreThoseOfTheirFrames) {
  // 64 words by WR, format 1 with sum: 17 out, 264 back, 5 for the ACK.
  EXPECT_NEAR(only_exchange(R"(fx-computer-link","model":"FX3U)", R"("address":"D0","count":64)"),
              (17 + 264 + 5) * 10 / 9.6, 0.001);
  // 11 03 00 6B 00 03 76 87, and back 11 03 06, 6 bytes, sum; 8E1 is 11 bits; a pause of 3.5.
  EXPECT_NEAR(only_exchange("modbus-rtu", R"("address":"hr:107","count":3)"),
              (8 + 11 + 3.5) * 11 / 9.6, 0.001);
  // The same in ASCII, 7E1: a colon, two digits per byte, LRC, CR LF; no pause.
  EXPECT_NEAR(only_exchange("modbus-ascii", R"("address":"hr:107","count":3)"),
              (17 + 23) * 10 / 9.6, 0.001);
}

TEST(PlanReport, LineTimeIsTheSumOfWhereItGoes) {
  // M0 and M16 are read together with M8-M15 between them; D0 and D2 together with D1.
  const std::string tags = R"({"name":"m","address":"M0","group":"g"},
                              {"name":"n","address":"M16","group":"g"},
                              {"name":"a","address":"D0","group":"g"},
                              {"name":"b","address":"D2","group":"g"})";
  std::string device = plc(tags, R"(,"gap_ms":5)");
  device.replace(device.find("turnaround_ms\":0"), 16, "turnaround_ms\":30");
  const GroupLoad group = plan_links(config_of(kSerial, device))[0].groups[0];
  ASSERT_EQ(group.exchanges.size(), 2U);
  const double character = 10 / 9.6;
  EXPECT_NEAR(ms(group.use.framing), 2 * 15 * character, 0.001);
  EXPECT_NEAR(ms(group.use.word_access), 2 * 2 * 7.0 / 8 * character, 0.001);
  EXPECT_NEAR(ms(group.use.unasked), (2 + 4) * character, 0.001);
  EXPECT_NEAR(ms(group.use.asked), (2 * 2.0 / 8 + 8) * character, 0.001);
  EXPECT_NEAR(ms(group.use.turnaround), 2 * 35, 0.001);
  const LineTimeUse& use = group.use;
  EXPECT_NEAR(ms(use.asked + use.framing + use.unasked + use.word_access + use.turnaround),
              ms(*group.line_time), 0.001);
}

TEST(PlanReport, AnEnquiryBeforeEachRequestIsFraming) {
  const GroupLoad group = plan_links(config_of(
      kSerial, plc(R"({"name":"a","address":"D0","group":"g"})", R"(,"enquire":"always")")))[0]
                              .groups[0];
  EXPECT_EQ(group.exchanges[0].chars, 19U + 2U);
  EXPECT_NEAR(ms(group.use.framing), (15 + 2) * 10 / 9.6, 0.001);
  EXPECT_NEAR(ms(*group.line_time), 21 * 10 / 9.6, 0.001);
}

TEST(PlanReport, TheBoundIsTheLongestPollAndTheCommandItself) {
  const auto links = plan_links(config_of(
      kSerial,
      plc(kLarge + R"(,{"name":"s","address":"D500","group":"g","access":"read_write"})")));
  // A poll of 64 bytes; a write of 11 + 4 and 1 characters; a read of 11 and 8.
  EXPECT_NEAR(ms(*links[0].command_bound), (15 + 128 + 16 + 19) * 10 / 9.6, 0.1);
}

TEST(PlanReport, TheBoundIsThatOfAWordThatMayBeWritten) {
  // D5000 needs a longer frame than D100: 17 + 1 and 13 + 8, instead of 15 + 1 and 11 + 8.
  const std::string tags = R"({"name":"a","address":"D100","group":"g","access":"read_write"},
                              {"name":"b","address":"D5000","group":"g"})";
  const auto of_tag = plan_links(config_of(kSerial, plc(tags)));
  EXPECT_NEAR(ms(*of_tag[0].command_bound), (21 + 16 + 19) * 10 / 9.6, 0.1);
  const auto of_range =
      plan_links(config_of(kSerial, plc(tags, R"(,"commands":{"allow":["D5000-D5001"]})")));
  EXPECT_NEAR(ms(*of_range[0].command_bound), (21 + 18 + 21) * 10 / 9.6, 0.1);
  // The longest of several writable tags counts, whatever its position.
  const std::string both = R"({"name":"b","address":"D5000","group":"g","access":"read_write"},
                              {"name":"a","address":"D100","group":"g","access":"read_write"})";
  EXPECT_EQ(plan_links(config_of(kSerial, plc(both)))[0].command_bound, of_range[0].command_bound);
  // In a range from short to long frames, the long ones count.
  const auto of_wide =
      plan_links(config_of(kSerial, plc(tags, R"(,"commands":{"allow":["D0-D7999"]})")));
  EXPECT_EQ(of_wide[0].command_bound, of_range[0].command_bound);
}

TEST(PlanReport, WithoutWordsTheBoundIsThatOfAForceWhichIsNotReadBack) {
  const auto links = plan_links(
      config_of(kSerial, plc(R"({"name":"m","address":"M0","group":"g","access":"read_write"})")));
  // The request for the model, 11 + 8, then a force of 9 and an ACK.
  EXPECT_NEAR(ms(*links[0].command_bound), (19 + 10) * 10 / 9.6, 0.1);
  const auto none = plan_links(
      config_of(kSerial,
                R"({"name":"p","link":"l","protocol":"modbus-rtu","groups":[{"name":"g"}],
          "tags":[{"name":"i","address":"ir:0","group":"g"}]})"));
  EXPECT_TRUE(none[0].busy_percent);
  EXPECT_FALSE(none[0].command_bound);
}

TEST(PlanReport, DeviceWithoutTagsIsAskedWhetherItIsThere) {
  const auto links = plan_links(config_of(
      kSerial,
      R"({"name":"p","link":"l","protocol":"modbus-ascii","turnaround_ms":0,"commands":{"allow":["hr:100"]}})"));
  EXPECT_GT(*links[0].busy_percent, 0.0);
  // 17 + 15 characters for one register, the longest poll in progress; then 17 and 17 for the
  // command, and 17 and 15 for the read-back.
  EXPECT_NEAR(ms(*links[0].command_bound), (32 + 34 + 32) * 10 / 9.6, 0.1);
}

TEST(PlanReport, SmallerBlocksTakeLongerAndLetCommandsThroughSooner) {
  const std::string tags =
      kLarge + R"(,{"name":"s","address":"D500","group":"g","access":"read_write"})";
  const LinkReport link = plan_links(config_of(kSerial, plc(tags)))[0];
  ASSERT_EQ(link.block_trade.size(), 4U);
  EXPECT_EQ(link.block_trade[0].block_bytes, 16U);
  EXPECT_EQ(link.block_trade[2].block_bytes, 64U);
  for (std::size_t i = 0; i + 1 < 3; ++i) {
    EXPECT_GT(link.block_trade[i].cycle, link.block_trade[i + 1].cycle);
    EXPECT_LT(*link.block_trade[i].command_bound, *link.block_trade[i + 1].command_bound);
    EXPECT_FALSE(link.block_trade[i].configured);
  }
  EXPECT_TRUE(link.block_trade[2].configured);
  EXPECT_EQ(link.block_trade[2].cycle, *link.groups[0].line_time);
  EXPECT_EQ(link.block_trade[2].command_bound, *link.command_bound);
  EXPECT_EQ(link.block_trade[3].block_bytes, 254U);  // extended reads only; D0-D99 are classic
  EXPECT_EQ(link.block_trade[3].cycle, link.block_trade[2].cycle);
  // A config with a listed block size gets the listed times, and its table lists the other sizes
  // too.
  const LinkReport small = plan_links(config_of(kSerial, plc(tags, R"(,"max_block_bytes":16)")))[0];
  EXPECT_EQ(*small.groups[0].line_time, link.block_trade[0].cycle);
  EXPECT_EQ(small.command_bound, link.block_trade[0].command_bound);
  ASSERT_EQ(small.block_trade.size(), 4U);
  EXPECT_TRUE(small.block_trade[0].configured);
  EXPECT_FALSE(small.block_trade[2].configured);
  EXPECT_EQ(small.block_trade[2].cycle, link.block_trade[2].cycle);
}

TEST(PlanReport, ABlockSizeThatThePlannerAloneKeepsIsTradedToo) {
  const auto links =
      plan_links(config_of(kSerial,
                           R"({"name":"p","link":"l","protocol":"modbus-rtu","max_block_bytes":100,
          "groups":[{"name":"g"}],"tags":[{"name":"r","address":"hr:0","count":200,"group":"g"}]})"));
  std::vector<std::uint32_t> sizes;
  for (const BlockTrade& trade : links[0].block_trade) {
    sizes.push_back(trade.block_bytes);
    EXPECT_EQ(trade.configured, trade.block_bytes == 100);
  }
  EXPECT_EQ(sizes, (std::vector<std::uint32_t>{16, 32, 64, 100, 250}));
  EXPECT_LT(links[0].block_trade[4].cycle, links[0].block_trade[3].cycle);
}

TEST(PlanReport, AnOverloadNamesTheIntervalThatFits) {
  Config config = config_of(kSerial, plc(kLarge));
  config.devices[0].groups[0].interval = milliseconds(400);
  const auto links = plan_links(config);
  EXPECT_GT(*links[0].busy_percent, 100.0);
  ASSERT_EQ(links[0].warnings.size(), 1U);
  // 511.5 ms, plus 17 characters for M8000 every 10 s.
  EXPECT_EQ(links[0].warnings[0],
            "p/g has an interval of 400 ms; the link needs 513 ms or more: set interval_ms to 520");
  // The named interval is sufficient; a slightly shorter one is not.
  config.devices[0].groups[0].interval = *links[0].groups[0].shortest_interval;
  EXPECT_LE(*plan_links(config)[0].busy_percent, 100.0);
  EXPECT_TRUE(plan_links(config)[0].warnings.empty());
  config.devices[0].groups[0].interval -= milliseconds(10);
  EXPECT_GT(*plan_links(config)[0].busy_percent, 100.0);
}

TEST(PlanReport, TheIntervalThatFitsLeavesRoomForTheQuestionForRun) {
  // At 300 baud the RUN request alone takes 6 % of the line.
  Config config = config_of(R"({"name":"l","serial":{"path":"/dev/x","baud":300}})", plc(kLarge));
  config.devices[0].groups[0].interval = *plan_links(config)[0].groups[0].shortest_interval;
  EXPECT_LE(*plan_links(config)[0].busy_percent, 100.0);
  EXPECT_GT(*plan_links(config)[0].busy_percent, 99.9);
}

TEST(PlanReport, WithoutASpeedThereAreNoTimes) {
  const auto links =
      plan_links(config_of(R"({"name":"l","tcp":{"host":"127.0.0.1","port":5551}})", plc(kLarge)));
  EXPECT_FALSE(links[0].busy_percent);
  EXPECT_FALSE(links[0].command_bound);
  EXPECT_FALSE(links[0].groups[0].line_time);
  EXPECT_FALSE(links[0].groups[0].exchanges.empty());
  EXPECT_NE(links[0].warnings[0].find("line_baud"), std::string::npos);
  const auto told = plan_links(config_of(
      R"({"name":"l","tcp":{"host":"127.0.0.1","port":5551},"line_baud":9600})", plc(kLarge)));
  EXPECT_EQ(told[0].baud, 9600);
  EXPECT_NEAR(ms(*told[0].groups[0].line_time), 511.5, 0.1);
  const auto udp = plan_links(config_of(R"({"name":"l","udp":{"host":"127.0.0.1","port":5007}})",
                                        R"({"name":"p","link":"l","protocol":"mc-1e"})"));
  EXPECT_FALSE(udp[0].command_bound);
  for (const std::string& warning : udp[0].warnings)
    EXPECT_EQ(warning.find("line_baud"), std::string::npos) << "it is not for UDP: " << warning;
}

TEST(PlanReport, OnlyALinkThatMayHaveASerialLineAsksForItsSpeed) {
  const auto asks = [](const std::string& device) {
    const auto links =
        plan_links(config_of(R"({"name":"l","tcp":{"host":"127.0.0.1","port":5007}})",
                             R"({"name":"p","link":"l","tags":[{"name":"t","address":")" + device));
    const auto& warnings = links[0].warnings;
    return std::ranges::any_of(
        warnings, [](const auto& each) { return each.find("line_baud") != each.npos; });
  };
  EXPECT_TRUE(asks(R"(hr:0"}],"protocol":"modbus-rtu"})"));
  EXPECT_TRUE(asks(R"(D0"}],"protocol":"mc-3c","model":"Q"})"));
  EXPECT_FALSE(asks(R"(hr:0"}],"protocol":"modbus-tcp"})"));
  EXPECT_FALSE(asks(R"(D0"}],"protocol":"mc-3e","model":"Q"})"));
}

TEST(PlanReport, AnOpenModelIsPlannedAsTheWidestAndThatIsSaid) {
  std::string device = plc(R"({"name":"d","address":"D5000","group":"g"})");
  device.replace(device.find("FX3U"), 4, "auto");
  const auto links = plan_links(config_of(kSerial, device));
  EXPECT_EQ(links[0].groups[0].exchanges.size(), 1U);
  EXPECT_NE(links[0].warnings[0].find("planned as FX3U"), std::string::npos);
}

TEST(PlanReport, AGroupWithoutAnIntervalAsksForNothing) {
  Config config = config_of(kSerial, plc(kLarge));
  config.devices[0].groups[0].interval = milliseconds(0);
  const LinkReport link = plan_links(config)[0];
  EXPECT_LT(*link.busy_percent, 1.0);  // only the RUN request has an interval
  EXPECT_FALSE(link.groups[0].shortest_interval);
  EXPECT_TRUE(link.warnings.empty());
}

TEST(PlanReport, AWhatIfJoinsTheGroupOfItsInterval) {
  Config config = config_of(kSerial, plc(kLarge));
  ASSERT_TRUE(add_what_if(config, "p D500..D563@1000"));
  EXPECT_EQ(config.devices[0].groups.size(), 1U);
  EXPECT_EQ(config.devices[0].tags.size(), 2U + 64U);
  EXPECT_EQ(config.devices[0].tags.back().point.address.text, "D563");
  ASSERT_TRUE(add_what_if(config, " p  M500 @ 200 "));
  EXPECT_EQ(config.devices[0].groups.back().name, "what-if");
  ASSERT_TRUE(add_what_if(config, "p X0-X17@300"));
  EXPECT_EQ(config.devices[0].groups.back().name, "what-if-300");
  EXPECT_EQ(config.devices[0].tags.back().point.address.text, "X17");
  EXPECT_EQ(config.devices[0].tags.size(), 2U + 64U + 1U + 16U);
  EXPECT_EQ(plan_links(config)[0].groups.size(), 3U);
}

TEST(PlanReport, AWhatIfMayLeaveOutTheLettersOfItsLastEnd) {
  const auto last_of = [](const std::string& protocol, const std::string& places) {
    Config config = config_of(R"({"name":"l","tcp":{"host":"h","port":5000}})",
                              R"({"name":"p","link":"l",)" + protocol + R"(,"tags":[]})");
    const auto added = add_what_if(config, "p " + places + "@200");
    return added ? config.devices[0].tags.back().point.address.text : added.error().text;
  };
  const std::string q = R"("protocol":"mc-3e","model":"Q")";
  EXPECT_EQ(last_of(q, "WA0..100"), "W100") << "the A is a digit";
  EXPECT_EQ(last_of(q, "sb0-1f"), "SB1F");
  EXPECT_EQ(last_of(R"("protocol":"fx-computer-link","model":"FX3U","station":0)", "T0 - 5"),
            "TN5");
  EXPECT_EQ(last_of(R"("protocol":"modbus-tcp")", "40101..40120"), "hr:119");
}

TEST(PlanReport, AWhatIfCostsAsMuchAsTheTagsWould) {
  Config config = config_of(kSerial, plc(kLarge));
  ASSERT_TRUE(add_what_if(config, "p D100..D131@1000"));
  const auto real = plan_links(
      config_of(kSerial, plc(kLarge + R"(,{"name":"e","address":"D100","count":32,"group":"g"})")));
  EXPECT_EQ(*plan_links(config)[0].groups[0].line_time, *real[0].groups[0].line_time);
}

TEST(PlanReport, AWrongWhatIfIsNamedAndChangesNothing) {
  const std::map<std::string, std::string> wrong = {
      {"q D1@5", "there is no device q; there is p"},
      {"p X8@5", "octal"},
      {"p D9..D5@5", "D9 and D5 are not a range"},
      {"p D5..M9@5", "D5 and M9 are not a range"},
      {"p D7990..D8005@5", "are not a range"},
      {"p K4M0..K4M40@5", "are not a range"},
      {"p D5@-1", "the interval after @ must be 0 to 86400000 ms"},
      {"p D5@86400001", "not \"86400001\""},
      {"p D5@", "not \"\""},
      {"p D5", "DEVICE FIRST..LAST@MS"},
      {"D5@200", "DEVICE FIRST..LAST@MS"},
      {"", "DEVICE FIRST..LAST@MS"}};
  Config config = config_of(kSerial, plc(kLarge));
  for (const auto& [what, words] : wrong) {
    const auto added = add_what_if(config, what);
    ASSERT_FALSE(added) << what;
    EXPECT_NE(added.error().text.find(words), std::string::npos) << added.error().text;
  }
  EXPECT_EQ(config.devices[0].tags.size(), 2U);
  EXPECT_EQ(config.devices[0].groups.size(), 1U);
  Config classic = config_of(
      kSerial, plc(R"({"name":"d","address":"D0","group":"g"})", R"(,"command_set":"classic")"));
  const auto far = add_what_if(classic, "p D1020..D1030@1000");
  ASSERT_FALSE(far);
  EXPECT_NE(far.error().text.find("D1024 cannot be reached"), std::string::npos)
      << far.error().text;
}

TEST(PlanReport, OverloadsAreTheWarningsOfThePlanAboutIntervals) {
  const auto device = [](const std::string& name, const std::string& interval) {
    return R"({"name":")" + name +
           R"(","link":"l","protocol":"fx-computer-link","model":"FX3U","station":)" +
           (name == "p" ? "0" : "1") + R"(,"groups":[{"name":"g","interval_ms":)" + interval +
           R"(}],"tags":[)" + kLarge + "]}";
  };
  const Config fits = config_of(kSerial, device("p", "5000") + "," + device("q", "5000"));
  EXPECT_TRUE(overloads(fits).empty());
  const Config config = config_of(kSerial, device("p", "500") + "," + device("q", "1000"));
  std::vector<std::string> planned;
  for (const LinkReport& link : plan_links(config))
    for (const std::string& warning : link.warnings) planned.push_back(link.name + ": " + warning);
  EXPECT_EQ(overloads(config), planned);
  ASSERT_EQ(planned.size(), 2U);
  EXPECT_TRUE(planned[0].starts_with("l: p/g has an interval of 500 ms; the link needs "))
      << planned[0];
  EXPECT_NE(planned[1].find(": set interval_ms to "), std::string::npos) << planned[1];
}

TEST(PlanReport, IntervalsThatOverloadsNamesFit) {
  const auto interval_in = [](const std::string& text) { return text.substr(text.rfind(' ') + 1); };
  const auto config = [](const std::string& interval) {
    std::string device = plc(kLarge);
    device.replace(device.find(R"("interval_ms":1000)"), 18, R"("interval_ms":)" + interval);
    return config_of(kSerial, device);
  };
  const auto found = overloads(config("100"));
  ASSERT_EQ(found.size(), 1U);
  EXPECT_TRUE(overloads(config(interval_in(found[0]))).empty()) << found[0];
}

TEST(PlanReport, LinkWhoseSpeedIsNotKnownIsNotOverloaded) {
  const std::string tcp = R"({"name":"l","tcp":{"host":"192.0.2.1","port":5551}})";
  std::string device = plc(kLarge);
  device.replace(device.find(R"("interval_ms":1000)"), 18, R"("interval_ms":1)");
  EXPECT_TRUE(overloads(config_of(tcp, device)).empty());
}

}  // namespace
}  // namespace fxagent
