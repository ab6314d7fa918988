#include "agent/commands/command_room.h"

#include <algorithm>
#include <bit>
#include <random>
#include <string>
#include <utility>

namespace fxagent {
namespace {

std::uint64_t chance() {
  std::random_device random;
  return (std::uint64_t{random()} << 32) | random();
}

/// SipHash-2-4 (Aumasson and Bernstein, 2012): a fingerprint that nobody can forge without the key.
std::uint64_t sip_hash(const IdFingerprints::Key& key, std::string_view text) {
  std::uint64_t v0 = key[0] ^ 0x736f6d6570736575;
  std::uint64_t v1 = key[1] ^ 0x646f72616e646f6d;
  std::uint64_t v2 = key[0] ^ 0x6c7967656e657261;
  std::uint64_t v3 = key[1] ^ 0x7465646279746573;
  const auto rounds = [&](int count) {
    for (int i = 0; i < count; ++i) {
      v0 += v1;
      v1 = std::rotl(v1, 13) ^ v0;
      v0 = std::rotl(v0, 32);
      v2 += v3;
      v3 = std::rotl(v3, 16) ^ v2;
      v0 += v3;
      v3 = std::rotl(v3, 21) ^ v0;
      v2 += v1;
      v1 = std::rotl(v1, 17) ^ v2;
      v2 = std::rotl(v2, 32);
    }
  };
  const auto take = [&](std::uint64_t word) {
    v3 ^= word;
    rounds(2);
    v0 ^= word;
  };
  std::uint64_t word = 0;
  std::size_t at = 0;
  for (const char c : text) {
    word |= std::uint64_t{static_cast<unsigned char>(c)} << (8 * (at % 8));
    if (++at % 8 == 0) take(std::exchange(word, 0));
  }
  take(word | std::uint64_t{text.size()} << 56);
  v2 ^= 0xFF;
  rounds(4);
  return v0 ^ v1 ^ v2 ^ v3;
}

}  // namespace

IdFingerprints::IdFingerprints(std::size_t most) : most_(most), key_{chance(), chance()} {}

std::uint64_t IdFingerprints::print_of(std::string_view device, std::string_view id) const {
  std::string text(device);
  text += '\0';  // in neither of them
  text += id;
  return sip_hash(key_, text);
}

bool IdFingerprints::has(std::string_view device, std::string_view id, SteadyTime now) const {
  const auto& by_print = all_.get<1>();
  const auto found = by_print.find(print_of(device, id));
  return found != by_print.end() && !(now > found->deadline && now - found->seen >= kRememberedFor);
}

bool IdFingerprints::make_room(SteadyTime now) {
  while (!all_.empty() && now > all_.front().deadline && now - all_.front().seen >= kRememberedFor)
    all_.pop_front();
  if (all_.size() < most_) return true;
  if (now <= earliest_deadline_) return false;
  SteadyTime earliest = SteadyTime::max();
  for (auto known = all_.begin(); known != all_.end(); ++known) {
    if (now > known->deadline) {
      all_.erase(known);
      return true;
    }
    earliest = std::min(earliest, known->deadline);
  }
  earliest_deadline_ = earliest;
  return false;
}

void IdFingerprints::add(std::string_view device, std::string_view id, SteadyTime seen,
                         SteadyTime deadline) {
  const std::uint64_t print = print_of(device, id);
  auto& by_print = all_.get<1>();
  if (const auto old = by_print.find(print); old != by_print.end()) by_print.erase(old);
  all_.push_back({print, seen, deadline});
  earliest_deadline_ = std::min(earliest_deadline_, deadline);
}

std::shared_ptr<const CommandRoom::Place> CommandRoom::take(std::uint32_t device,
                                                            std::size_t bytes) {
  std::size_t& own = by_device_[device];
  if (own + bytes > kBytesOfADevice && bytes_ + bytes > kMostBytes) return nullptr;
  own += bytes;
  bytes_ += bytes;
  return std::make_shared<const Place>(shared_from_this(), device, bytes);
}

void CommandRoom::give_back(std::uint32_t device, std::size_t bytes) {
  by_device_[device] -= bytes;
  bytes_ -= bytes;
}

}  // namespace fxagent
