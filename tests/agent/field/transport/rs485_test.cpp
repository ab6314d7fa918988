#include "agent/field/transport/serial_driver.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <linux/serial.h>
#include <stdlib.h>
#include <unistd.h>

#include <string>

namespace fxagent::test {
namespace {

using std::chrono::milliseconds;

TEST(Rs485, KernelGetsDirectionAndDelays) {
  const serial_rs485 usual = kernel_settings({});
  EXPECT_EQ(usual.flags, SER_RS485_ENABLED | SER_RS485_RTS_ON_SEND);
  EXPECT_EQ(usual.delay_rts_before_send, 0U);
  EXPECT_EQ(usual.delay_rts_after_send, 0U);
  const serial_rs485 inverse = kernel_settings(
      {.rts_on_send = false, .delay_before = milliseconds(2), .delay_after = milliseconds(7)});
  EXPECT_EQ(inverse.flags, SER_RS485_ENABLED | SER_RS485_RTS_AFTER_SEND);
  EXPECT_EQ(inverse.delay_rts_before_send, 2U);
  EXPECT_EQ(inverse.delay_rts_after_send, 7U);
}

TEST(Rs485, WhatADriverChangesSilentlyIsNamed) {
  const Rs485 wish{
      .rts_on_send = true, .delay_before = milliseconds(5), .delay_after = milliseconds(6)};
  const serial_rs485 asked = kernel_settings(wish);
  EXPECT_EQ(not_taken(asked, asked), "");

  serial_rs485 got = asked;
  got.flags |= SER_RS485_RX_DURING_TX;  // set by others, not checked
  EXPECT_EQ(not_taken(asked, got), "");
  got.flags = 0;
  EXPECT_NE(not_taken(asked, got).find("does not switch"), std::string::npos)
      << not_taken(asked, got);

  got = asked;
  got.flags = SER_RS485_ENABLED | SER_RS485_RTS_AFTER_SEND;
  EXPECT_NE(not_taken(asked, got).find("set rs485/rts_on_send to false"), std::string::npos);
  EXPECT_NE(not_taken(got, asked).find("cannot lower RTS"), std::string::npos);

  got = asked;
  got.delay_rts_before_send = 0;
  EXPECT_NE(not_taken(asked, got).find("delay_before_ms 5, its driver changes it to 0"),
            std::string::npos);
  got = asked;
  got.delay_rts_after_send = 1;
  EXPECT_NE(not_taken(asked, got).find("delay_after_ms 6, its driver changes it to 1"),
            std::string::npos);
}

TEST(Rs485, PortWithoutItSaysSoWithTheCure) {
  const int pty = posix_openpt(O_RDWR | O_NOCTTY);
  ASSERT_GE(pty, 0);
  const std::string fault = switch_direction(pty, {});
  ::close(pty);
  EXPECT_NE(fault.find("its driver does not support it"), std::string::npos) << fault;
  EXPECT_NE(fault.find("remove rs485"), std::string::npos) << fault;
}

}  // namespace
}  // namespace fxagent::test
