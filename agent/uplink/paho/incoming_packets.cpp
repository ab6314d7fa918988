#include "agent/uplink/paho/incoming_packets.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <utility>

namespace fxagent {
namespace {

// MQTT, section 2.1.2.
constexpr unsigned kConnack = 2;
constexpr unsigned char kQosBits = 0x06;
constexpr unsigned char kQos1 = 0x02;
// MQTT 5, section 2.2.2.2: the properties of a message.
constexpr unsigned char kPayloadFormat = 0x01;
constexpr unsigned char kMessageExpiry = 0x02;
constexpr unsigned char kContentType = 0x03;
constexpr unsigned char kResponseTopic = 0x08;
constexpr unsigned char kCorrelation = 0x09;
constexpr unsigned char kSubscription = 0x0B;
constexpr unsigned char kTopicAlias = 0x23;
constexpr unsigned char kUserProperty = 0x26;

/// Returns the size of a byte string and its two-byte length; more than `size` if it does not fit.
std::size_t text_size(const unsigned char* at, std::size_t size) noexcept {
  return size < 2 ? size + 1 : 2 + (std::size_t{at[0]} << 8 | at[1]);
}

/// Returns the size of a variable byte integer; 0 if it does not end.
std::size_t number_size(const unsigned char* at, std::size_t size) noexcept {
  for (std::size_t i = 0; i < std::min<std::size_t>(size, 4); ++i)
    if (at[i] < 0x80) return i + 1;
  return 0;
}

std::size_t number(const unsigned char* at, std::size_t digits) noexcept {
  std::size_t value = 0;
  for (std::size_t i = digits; i-- > 0;) value = value << 7 | (at[i] & 0x7F);
  return value;
}

/// Returns the size of a property with its identifier; 0 if it is not a property of a message, or
/// does not fit.
std::size_t property_size(const unsigned char* at, std::size_t size) noexcept {
  const unsigned char* const value = at + 1;
  const std::size_t room = size - 1;
  const auto fits = [room](std::size_t used) { return used <= room ? 1 + used : 0; };
  switch (*at) {
    case kPayloadFormat:
      return fits(1);
    case kTopicAlias:
      return fits(2);
    case kMessageExpiry:
      return fits(4);
    case kSubscription: {
      const std::size_t digits = number_size(value, room);
      return digits == 0 ? 0 : fits(digits);
    }
    case kContentType:
    case kResponseTopic:
    case kCorrelation:
      return fits(text_size(value, room));
    case kUserProperty: {
      const std::size_t name = text_size(value, room);
      return name > room ? 0 : fits(name + text_size(value + name, room - name));
    }
    default:
      return 0;
  }
}

/// Moves the first of each property that the agent uses to the front. Returns their size.
std::size_t gather(unsigned char* properties, std::size_t size) noexcept {
  constexpr std::array kUsed{kResponseTopic, kCorrelation, kMessageExpiry};
  std::array<bool, kUsed.size()> seen{};
  std::size_t kept = 0;
  for (std::size_t at = 0; at < size;) {
    const std::size_t one = property_size(properties + at, size - at);
    if (one == 0) break;
    const auto used =
        static_cast<std::size_t>(std::ranges::find(kUsed, properties[at]) - kUsed.begin());
    if (used < kUsed.size() && !std::exchange(seen[used], true)) {
      std::memmove(properties + kept, properties + at, one);
      kept += one;
    }
    at += one;
  }
  return kept;
}

void bound_properties(unsigned char* body, std::size_t size, bool has_id) noexcept {
  const std::size_t begin = text_size(body, size) + (has_id ? 2 : 0);
  if (begin >= size) return;
  unsigned char* const length = body + begin;
  const std::size_t digits = number_size(length, size - begin);
  if (digits == 0) return;
  unsigned char* const properties = length + digits;
  // Paho detects a length beyond the end of the packet only after it has copied everything up to
  // there.
  const std::size_t used = std::min(number(length, digits), size - begin - digits);
  if (used <= kMaxPropertiesIn) return;
  std::size_t kept = gather(properties, used);
  properties[kept] = 0;
  for (std::size_t i = 0; i < digits; ++i, kept >>= 7)
    length[i] = static_cast<unsigned char>((kept & 0x7F) | (i + 1 < digits ? 0x80 : 0));
}

}  // namespace

std::size_t IncomingPackets::most() const noexcept {
  if (next_ != Next::body) return kMaxPacketIn;
  if (!is_message()) return kMaxPropertiesIn;
  return welcomed_ ? kMaxPacketIn : 0;
}

void IncomingPackets::take(unsigned char* at, std::size_t asked, std::size_t got) noexcept {
  if (got == 0) return;
  switch (next_) {
    case Next::head:
      if (*at >> 4 == 3 && (*at & kQosBits) == 2 * kQos1)
        *at = static_cast<unsigned char>((*at & ~kQosBits) | kQos1);
      head_ = *at;
      size_ = 0;
      shift_ = 0;
      next_ = Next::length;
      return;
    case Next::length:
      return take_length(*at);
    case Next::body:
      // Each time, Paho requests all that is left and appends it to what it has.
      if (got == asked) end_packet(at + got - size_);
      return;
  }
}

void IncomingPackets::take_length(unsigned char digit) noexcept {
  size_ |= static_cast<std::size_t>(digit & 0x7F) << shift_;
  shift_ += 7;
  if (digit >= 0x80) return;
  next_ = size_ == 0 ? Next::head : Next::body;
}

void IncomingPackets::end_packet(unsigned char* body) noexcept {
  next_ = Next::head;
  if (head_ >> 4 == kConnack) {
    welcomed_ = true;
    has_properties_ = size_ > 2;
  }
  if (is_message() && has_properties_) bound_properties(body, size_, (head_ & kQosBits) != 0);
}

}  // namespace fxagent
