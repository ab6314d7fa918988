#include <gtest/gtest.h>

#include "protocol/mc/one_e.h"
#include "tests/protocol/answers.h"

namespace fxagent::mc {
namespace {

using namespace test;
using Values = std::vector<std::string>;

Explanation explained(Model model, ByteView frame, std::optional<Direction> direction) {
  return OneE({.model = model}).explain(frame, direction);
}

Explanation explain(std::string_view frame, Model model = Model::fx3u) {
  return explained(model, hex(frame), std::nullopt);
}

Explanation explain_text(std::string_view frame) {
  return explained(Model::fx3u, Bytes(frame.begin(), frame.end()), std::nullopt);
}

TEST(OneEExplanation, NamesEveryFrameOfTheTranscripts) {
  for (const test::Exchange& e : test::read_frames("mc_1e.txt")) {
    SCOPED_TRACE(e.where());
    const auto model = *model_named(e.model);
    const auto out = explained(model, e.request, std::nullopt);
    ASSERT_TRUE(out.ok) << out.error.value_or("");
    EXPECT_FALSE(out.ambiguous);
    EXPECT_EQ(out.direction, Direction::request);
    if (e.device != "-") {
      EXPECT_EQ(out.device, e.device);
    }
    EXPECT_EQ(field(out, "data code"), e.command_set.starts_with("ascii") ? "ASCII" : "binary");
    EXPECT_FALSE(explained(model, e.request, Direction::reply).ok);
    if (e.reply.empty()) continue;
    const auto reply = explained(model, e.reply, std::nullopt);
    EXPECT_TRUE(reply.ok) << reply.error.value_or("");
    EXPECT_EQ(reply.direction, Direction::reply);
    const bool reads = e.operation.starts_with("read") || e.operation == "identify";
    const bool refused = e.operation == "nak" || e.operation == "beyond";
    EXPECT_EQ(reply.operation, refused ? "nak" : reads ? "data" : "ack");
  }
}

TEST(OneEExplanation, AReadSaysAllOfIt) {
  const auto out = explain("00 FF 0A 00 64 00 00 00 20 4D 08 00");
  EXPECT_EQ(out.operation, "read");
  EXPECT_EQ(out.command, "00");
  EXPECT_EQ(out.device, "M100");
  EXPECT_EQ(out.count, 8U);
  EXPECT_EQ(field(out, "PC number"), "FF");
  EXPECT_EQ(field(out, "monitoring timer"), "2500 ms");
  EXPECT_EQ(explain("00 FF 0A 00 64 00 00 00 20 4D 00 00").count, 256U);
  EXPECT_EQ(explain("01 FF 00 00 40 00 00 00 20 59 02 00").count, 32U);
  EXPECT_EQ(field(explain("13 FF 00 00"), "monitoring timer"), "none");
}

TEST(OneEExplanation, DevicesAreThoseOfTheModel) {
  const std::string_view x = "01 FF 0A 00 10 00 00 00 20 58 01 00";
  EXPECT_EQ(explain(x).device, "X20");
  EXPECT_EQ(explain(x, Model::q).device, "X10");
  const std::string_view counter = "01 FF 0A 00 C8 00 00 00 4E 43 02 00";
  EXPECT_EQ(explain(counter).device, "CN200");
  EXPECT_EQ(explain(counter).count, 1U);
  EXPECT_EQ(explain(counter, Model::q).count, 2U);
  EXPECT_EQ(explain("00 FF 0A 00 40 1F 00 00 20 4D 01 00").device, "M8000");
}

TEST(OneEExplanation, ValuesOfWritesAndAnswersAreShown) {
  EXPECT_EQ(explain("03 FF 0A 00 64 00 00 00 20 44 03 00 34 12 76 98 09 01").values,
            (Values{"1234", "9876", "0109"}));
  EXPECT_EQ(explain("02 FF 0A 00 0A 00 00 00 20 4D 05 00 10 10 10").values,
            (Values{"1", "0", "1", "0", "1"}));
  EXPECT_EQ(explain_text("03FF000A434E000000DC0400614E00BC014002B9").values,
            (Values{"00BC614E", "02B90140"}));
  const auto scattered = explain("04 FF 0A 00 02 00 32 00 00 00 20 4D 01 0F 00 00 00 20 59 00");
  EXPECT_EQ(scattered.device, "M50,Y17");
  EXPECT_EQ(scattered.values, (Values{"1", "0"}));
  EXPECT_EQ(explain("81 00 9D 82 3E 55").values, (Values{"829D", "553E"}));
  EXPECT_EQ(explain_text("8100829D553E").values, (Values{"829D", "553E"}));
  EXPECT_EQ(explain("80 00 10 10").values, (Values{"1", "0", "1", "0"}));
  EXPECT_EQ(field(explain("95 00 F4 00"), "model"), "FX3G");
  EXPECT_EQ(field(explain("95 00 A3 00"), "model"), "an unknown one");
}

TEST(OneEExplanation, ARefusalHasItsReason) {
  EXPECT_EQ(field(explain("81 57"), "reason"), "57: too many points, or beyond the last device");
  EXPECT_EQ(field(explain_text("815B1000"), "reason"), "5B 10: no PLC has this PC number (`pc`)");
}

TEST(OneEExplanation, TheLoopBackTestIsKnownAndNeverSent) {
  const auto out = explain("16 FF 0A 00 04 41 42 43 44");
  EXPECT_TRUE(out.ok) << out.error.value_or("");
  EXPECT_EQ(field(out, "text"), "41 42 43 44");
  EXPECT_TRUE(explain("96 00 04 41 42 43 44").ok);
}

TEST(OneEExplanation, WhatIsWrongIsSaid) {
  struct Row {
    std::string_view frame;
    std::string_view error;
  };
  for (const Row& row : std::vector<Row>{
           {"", "no bytes"},
           {"06", "06 is neither a command of a 1E frame nor its answer"},
           {"01 FF 0A", "the request is truncated"},
           {"01 FF 0A 00 64 00", "the request is truncated"},
           {"01 FF 0A 00 64 00 00 00 21 44 01 00", "there is no device with this code"},
           {"01 FF 0A 00 64 00 00 00 20 44 01 01", "the byte after the number of points is not 00"},
           {"01 FF 0A 00 64 00 00 00 20 44 00 00", "the number of points is 0"},
           {"00 FF 0A 00 64 00 00 00 20 44 01 00", "D100 is a word, not a bit"},
           {"01 FF 0A 00 64 00 00 00 20 44 01 00 00", "1 bytes are left over"},
           {"03 FF 0A 00 64 00 00 00 20 44 02 00 34 12", "2 bytes of data given, 4 expected"},
           {"02 FF 0A 00 64 00 00 00 20 4D 01 00 30", "the data are not bits"},
           {"04 FF 0A 00 02 00 32 00 00 00 20 4D 01", "only 1 of 2 points are present"},
           {"04 FF 0A 00 01 00 32 00 00 00 20 4D 02", "02 is not a value of M50"},
           {"04 FF 0A 00 01 00 32 00 00 00 20 44 01", "D50 is not a device for this command"},
           {"05 FF 0A 00 01 00 C8 00 00 00 4E 43 01 00", "CN200 is not a device for this command"},
           {"16 FF 0A 00 04 41", "the text is shorter than its length says"},
           {"16 FF 0A 00", "the request is truncated"},
           {"81", "the answer is truncated"},
           {"81 00", "there are no data"},
           {"81 00 12", "an odd count of bytes cannot be words"},
           {"83 00 12", "nothing follows the end code of a write"},
           {"80 00 22", "the data are not bits"},
           {"81 57 01", "only an abnormal code and 00 may follow an end code"}}) {
    const auto out = explain(row.frame);
    EXPECT_FALSE(out.ok) << row.frame;
    EXPECT_EQ(out.error.value_or(""), row.error) << row.frame;
  }
  EXPECT_EQ(explain_text("01FF000").error, "a frame in ASCII has pairs of hex digits only");
  EXPECT_EQ(explain_text("01FG000A").error, "a frame in ASCII has pairs of hex digits only");
}

TEST(OneEExplanation, AnyBytesAreGoodOrHaveAnError) {
  for (const test::Exchange& e : test::read_frames("mc_1e.txt"))
    for (const Bytes& whole : {e.request, e.reply})
      for (std::size_t n = 0; n <= whole.size(); ++n) {
        Bytes part(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(n));
        const auto judge = [&](const Explanation& out) {
          EXPECT_NE(out.ok, out.error.has_value()) << "line " << e.line << ", " << n << " bytes";
        };
        judge(explained(Model::fx3u, part, std::nullopt));
        for (std::uint8_t& byte : part) {
          byte ^= 0x11;
          judge(explained(Model::q, part, Direction::reply));
          byte ^= 0x11;
        }
      }
}

}  // namespace
}  // namespace fxagent::mc
