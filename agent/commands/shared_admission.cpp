#include "agent/commands/shared_admission.h"

#include <openssl/core_names.h>
#include <openssl/evp.h>
#include <openssl/params.h>

#include <algorithm>
#include <array>
#include <bit>
#include <boost/multi_index/hashed_index.hpp>
#include <boost/multi_index/member.hpp>
#include <boost/multi_index/sequenced_index.hpp>
#include <boost/multi_index_container.hpp>
#include <random>
#include <stdexcept>
#include <string>
#include <utility>

namespace fxagent {
namespace {

std::uint64_t chance() {
  std::random_device random;
  return (std::uint64_t{random()} << 32) | random();
}

/// SipHash-2-4 (Aumasson and Bernstein, 2012): a fingerprint that cannot be forged without the key.
/// Throws std::runtime_error if libcrypto lacks it.
std::uint64_t sip_hash(const IdFingerprints::Key& key, std::string_view text) {
  std::array<unsigned char, sizeof(std::uint64_t)> print{};
  std::size_t size = print.size();
  const std::array params{OSSL_PARAM_construct_size_t(OSSL_MAC_PARAM_SIZE, &size),
                          OSSL_PARAM_construct_end()};
  std::size_t written = 0;
  if (EVP_Q_mac(nullptr, OSSL_MAC_NAME_SIPHASH, nullptr, nullptr, params.data(), key.data(),
                sizeof key, reinterpret_cast<const unsigned char*>(text.data()), text.size(),
                print.data(), print.size(), &written) == nullptr ||
      written != print.size())
    throw std::runtime_error("libcrypto has no SipHash");
  return std::bit_cast<std::uint64_t>(print);
}

struct Known {
  std::uint64_t print = 0;
  SteadyTime seen{};
  SteadyTime deadline{};
};
bool is_old(const Known& known, SteadyTime now) {
  return now > known.deadline && now - known.seen >= kRememberedFor;
}

using KnownOnes = boost::multi_index_container<
    Known,
    boost::multi_index::indexed_by<boost::multi_index::sequenced<>,
                                   boost::multi_index::hashed_unique<boost::multi_index::member<
                                       Known, std::uint64_t, &Known::print>>>>;

}  // namespace

struct IdFingerprints::All : KnownOnes {};

IdFingerprints::IdFingerprints(std::size_t most)
    : most_(most), key_{chance(), chance()}, all_(std::make_unique<All>()) {}
IdFingerprints::~IdFingerprints() = default;
IdFingerprints& IdFingerprints::operator=(IdFingerprints&&) noexcept = default;

std::size_t IdFingerprints::size() const { return all_->size(); }

std::uint64_t IdFingerprints::print_of(std::string_view device, std::string_view id) const {
  std::string text(device);
  text += '\0';  // occurs in neither of them
  text += id;
  return sip_hash(key_, text);
}

bool IdFingerprints::has(std::string_view device, std::string_view id, SteadyTime now) const {
  if (all_->empty()) return false;
  const auto& by_print = all_->get<1>();
  const auto found = by_print.find(print_of(device, id));
  return found != by_print.end() && !is_old(*found, now);
}

bool IdFingerprints::make_room(SteadyTime now) {
  while (!all_->empty() && is_old(all_->front(), now)) all_->pop_front();
  if (all_->size() < most_) return true;
  if (now <= earliest_deadline_) return false;
  SteadyTime earliest = SteadyTime::max();
  for (auto known = all_->begin(); known != all_->end(); ++known) {
    if (now > known->deadline) {
      all_->erase(known);
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
  all_->get<1>().erase(print);
  all_->push_back({print, seen, deadline});
  earliest_deadline_ = std::min(earliest_deadline_, deadline);
}

std::weak_ptr<std::string> SharedAdmission::keep(std::string result, ResultOf command) {
  constexpr std::size_t kOverhead = 128;  // bytes; of the allocations, and for the total latency
  result.shrink_to_fit();
  const std::size_t bytes = result.size() + kOverhead;
  auto& results = command == ResultOf::refused ? refused_results_ : results_;
  const std::weak_ptr<std::string> kept =
      results.emplace_back(std::make_shared<std::string>(std::move(result)), bytes).first;
  for (result_bytes_ += bytes; result_bytes_ > kMostResultBytes;) {
    auto& from = refused_results_.empty() ? results_ : refused_results_;
    result_bytes_ -= from.front().second;
    from.pop_front();
  }
  return kept;
}

SharedAdmission::Place SharedAdmission::take(std::uint32_t device, std::size_t bytes) {
  std::size_t& own = by_device_[device];
  if (own + bytes > kBytesOfADevice && bytes_ + bytes > kMostBytes) return nullptr;
  own += bytes;
  bytes_ += bytes;
  return {this, [room = shared_from_this(), device, bytes](const void*) {
            room->by_device_[device] -= bytes;
            room->bytes_ -= bytes;
          }};
}

}  // namespace fxagent
