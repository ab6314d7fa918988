#include "agent/field/transport/host_lookup.h"

#include <sys/resource.h>

#include <asio/ip/tcp.hpp>
#include <asio/steady_timer.hpp>
#include <utility>

#include "agent/field/transport/stream_io.h"

namespace fxagent {

using asio::ip::tcp;

/// The kernel assigns the lowest free number. If links took every descriptor, the broker connection
/// and the store could not be reopened.
bool takes_from_others(int fd) {
  rlimit limit{};
  return getrlimit(RLIMIT_NOFILE, &limit) == 0 &&
         static_cast<rlim_t>(fd) + kFilesNotForLinks >= limit.rlim_cur;
}

std::string why_failed(const asio::error_code& error) {
  if (error == asio::error::host_unreachable || error == asio::error::network_unreachable)
    return "no way to this address (" + error.message() +
           "): is the device on, is the network up, and is the address right?";
  if (error == asio::error::no_descriptors)
    return error.message() + ": raise the limit of open files, LimitNOFILE of the unit";
  return error.message();
}

void start_looking_up(const asio::any_io_executor& executor) {
  tcp::resolver resolver(executor);
  resolver.async_resolve("127.0.0.1", "0",
                         tcp::resolver::numeric_host | tcp::resolver::numeric_service,
                         [](const asio::error_code&, const tcp::resolver::results_type&) {});
}

/// A lookup that can be abandoned: the system's lookup has no time limit and cannot be cancelled
/// once it has begun.
/// Owned by the waiting coroutine and by the lookup itself, whichever lasts longer.
struct HostLookup::UnderWay {
  explicit UnderWay(const asio::any_io_executor& executor) : resolver(executor), over(executor) {}
  tcp::resolver resolver;
  asio::steady_timer over;  ///< cancelled when the answer is here or no longer wanted
  bool answered = false;
  asio::error_code error;
  std::vector<asio::ip::address> found;
};

asio::awaitable<Result<std::vector<asio::ip::address>>> HostLookup::find(
    asio::any_io_executor executor, const std::string& host, const std::string& channel,
    SteadyTime deadline) {
  asio::error_code not_numeric;
  const auto address = asio::ip::make_address(host, not_numeric);
  if (!not_numeric) co_return std::vector{address};
  const auto lookup = std::make_shared<UnderWay>(executor);
  under_way_ = lookup;
  lookup->over.expires_at(deadline);
  lookup->resolver.async_resolve(
      host, "", [lookup](const asio::error_code& error, const tcp::resolver::results_type& found) {
        lookup->answered = true;
        lookup->error = error;
        for (const auto& entry : found) lookup->found.push_back(entry.endpoint().address());
        lookup->over.cancel();
      });
  co_await lookup->over.async_wait(use_result);
  under_way_.reset();
  if (!lookup->answered) {
    // One thread looks up all names. If this one is still waiting there, it would delay the others.
    lookup->resolver.cancel();
    co_return fail(ErrorCode::link_down, channel + ": the name lookup got no answer");
  }
  if (lookup->error)
    co_return fail(ErrorCode::link_down,
                   channel + ": the name is not found (" + lookup->error.message() +
                       "): is it spelt correctly, and does this machine's name server know it?");
  if (lookup->found.empty())
    co_return fail(ErrorCode::link_down, channel + ": the name has no address");
  co_return std::move(lookup->found);
}

void HostLookup::cancel() noexcept {
  if (under_way_) under_way_->over.cancel();
}

}  // namespace fxagent
