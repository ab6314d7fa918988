#include "agent/field/transport/serial_driver.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <linux/serial.h>
#include <stdlib.h>
#include <unistd.h>

#include "tests/support/says.h"

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
  expect_says(not_taken(asked, got), "does not switch");

  got = asked;
  got.flags = SER_RS485_ENABLED | SER_RS485_RTS_AFTER_SEND;
  expect_says(not_taken(asked, got), "set rs485/rts_on_send to false");
  expect_says(not_taken(got, asked), "cannot lower RTS");

  got = asked;
  got.delay_rts_before_send = 0;
  expect_says(not_taken(asked, got), "delay_before_ms 5, its driver changes it to 0");
  got = asked;
  got.delay_rts_after_send = 1;
  expect_says(not_taken(asked, got), "delay_after_ms 6, its driver changes it to 1");
}

TEST(Rs485, PortWithoutItSaysSoWithTheCure) {
  const int pty = posix_openpt(O_RDWR | O_NOCTTY);
  ASSERT_GE(pty, 0);
  const std::string fault = switch_direction(pty, {});
  ::close(pty);
  expect_says(fault, "its driver does not support it");
  expect_says(fault, "remove rs485");
}

}  // namespace
}  // namespace fxagent::test
