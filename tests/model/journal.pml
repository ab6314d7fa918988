// The journal of a standby pair: commands, announcements, results and blocks of sequence numbers.
//
// There is no time here, so every order of events is included. The lease is one bit per member, `may_write`: the old
// holder can write until the moment when the new one ends its wait. lease.pml shows that this is so.
//
// A member's subscription to the journal is a set of entries that have not arrived yet. They arrive in any order, but
// all of them before a marker that the member published after them.
//
// FAULTS bounds restarts of members, false alarms, and lost connections together; the broker restarts BROKER_CRASHES
// times. After the last fault everything comes to rest, and then each command must have its result.
//
// Macros: the bounds, SEQ (blocks of sequence numbers too), and the mutations and variants listed in README.md.

#ifndef NC
#define NC 2  // commands
#endif
#ifndef SENDS
#define SENDS 2  // times that each is sent, with the same id
#endif
#ifndef FAULTS
#define FAULTS 2
#endif
#ifndef BROKER_CRASHES
#define BROKER_CRASHES 1
#endif
#define BLOCKS 3  // blocks of sequence numbers

#define NOBODY 2
#define OTHER(m) (1 - m)
#define BIT(c) (1 << (c))
#define HAS(set, c) (((set) >> (c)) & 1)
#define ADD(set, c) set = set | BIT(c)
#define REMOVE(set, c) set = set & ~BIT(c)

mtype = { standby, claiming, connected, acting };
// What a holder did with a command in this tenure.
mtype = { fresh, announcing, announced, may_run, ran, reporting, giving_up, closed };
mtype = { no_result, succeeded, unknown_outcome };

typedef Member {
  mtype role = standby;
  bool may_write;
  byte got;           // commands received in this tenure
  byte observed;      // commands received on the own session: variant OBSERVE
  mtype at[NC] = fresh;
  byte ids;           // announcements it has read
  byte results;       // results it has read
  byte marker;        // 0: none, 1: sent, 2: accepted by the broker
  byte ids_before;    // what is still to arrive before the marker
  byte results_before;
  byte blind;         // 1: it missed entries, 2: it also forgot what it had read
#ifdef SEQ
  byte top;           // highest block that it has read of
  byte top_before;
  byte block;
  byte reserving;     // 0: no, 1: sent, 2: accepted, 3: in use
#endif
};
Member member[2];
#define M member[me]
#define O member[OTHER(me)]

// The broker.
byte session = NOBODY;  // the member whose connection has the pair's client id
byte latest = NOBODY;   // the member that had the session last
byte commands;          // not acknowledged on the pair's session
byte own_commands[2];   // not acknowledged on the members' own sessions
byte late_ids[2], late_results[2];
byte top;
byte crashes = BROKER_CRASHES;

// The plant and the commander.
byte faults = FAULTS;
byte left[NC] = SENDS;
byte runs[NC];
mtype outcome[NC] = no_result;
byte used;
bool over;

#ifdef OWN_SESSION
#define ACCEPTED(me) true
#else
#define ACCEPTED(me) (session == me)
#endif
#ifdef BLIND_RULE
#define SEES(m) (member[m].blind == 0)
#else
#define SEES(m) true
#endif
#ifdef SEQ
#define TOP_READ(m) (member[m].top >= member[m].top_before)
#else
#define TOP_READ(m) true
#endif

inline end_tenure() {
  M.marker = 0;
  M.ids_before = 0;
  M.results_before = 0;
  M.got = 0;
#ifdef SEQ
  M.top_before = 0;
  M.reserving = 0;
  M.block = 0;
#endif
#ifndef KEEP_TENURE
  for (c : 0 .. NC - 1) { M.at[c] = fresh }
#endif
  c = 0
}

inline record(c, value) {
#ifndef ONLY_RUNS
  assert(outcome[c] == no_result || outcome[c] == value);
#endif
  outcome[c] = value;
  ADD(late_results[0], c);
  ADD(late_results[1], c)
}

inline acknowledge(c) {
  if
  :: session == me -> REMOVE(commands, c)
  :: else
  fi
}

inline go_active() {
  M.role = acting;
  M.marker = 0;
  if
  :: latest == me -> M.may_write = true; O.may_write = false
  :: latest != me && O.role != acting -> M.may_write = true  // a valid lease may outlast the session
  :: else
  fi
}

#define IDLE_SESSION(me) (session != OTHER(me) || O.role == standby)

proctype holder(bit me) {
  byte c;
  do
  :: atomic { M.role == standby && (IDLE_SESSION(me) || faults > 0) ->
       if
       :: IDLE_SESSION(me)
       :: else -> faults--
       fi;
       end_tenure(); M.role = claiming }
  :: d_step { M.role == claiming -> session = me; latest = me; M.role = connected }

#ifdef NO_MARKER
  :: d_step { M.role == connected -> go_active() }
#else
  :: d_step { M.role == connected && M.marker == 0 -> M.marker = 1 }
  :: d_step { M.marker == 1 && ACCEPTED(me) ->
       M.marker = 2; M.ids_before = late_ids[me]; M.results_before = late_results[me];
#ifdef SEQ
       M.top_before = top;
#endif
     }
  :: d_step { M.role == connected && M.marker == 2 && M.ids_before == 0 && M.results_before == 0 && TOP_READ(me) ->
       go_active() }
#endif
  // It may notice late, or never, that its session is gone.
  :: d_step { (M.role == connected || M.role == acting) && session != me -> M.role = standby; end_tenure() }

  // A restart. What it has read of the journal is on its disk.
  :: d_step { !over && faults > 0 -> faults--; M.role = standby; M.may_write = false; M.observed = 0;
       end_tenure();
       for (c : 0 .. NC - 1) { M.at[c] = fresh }
       c = 0;
#ifdef FORGET
       M.ids = 0; M.results = 0; M.blind = 2;
#endif
     }
#ifdef EPHEMERAL
  // Its own session ends at the broker while it is away.
  :: d_step { !over && faults > 0 && (late_ids[me] != 0 || late_results[me] != 0) ->
       faults--; late_ids[me] = 0; late_results[me] = 0; M.ids_before = 0; M.results_before = 0;
       if
       :: M.blind == 0 -> M.blind = 1
       :: else
       fi }
#endif
#ifdef BLIND_RULE
  // The other one sends its whole journal.
  :: d_step { M.blind > 0 && O.blind == 0 ->
       M.ids = M.ids | O.ids | late_ids[OTHER(me)]; M.results = M.results | O.results | late_results[OTHER(me)];
       M.blind = 0 }
#ifdef MERGE
  // Both have a gap, and both have ended their tenures: each id is known to the one that announced it.
  :: d_step { M.blind == 1 && O.blind == 1 && (session == me || M.role == standby) &&
              (session == OTHER(me) || O.role == standby) ->
       M.ids = M.ids | O.ids; O.ids = M.ids; M.results = M.results | O.results; O.results = M.results;
       M.blind = 0; O.blind = 0 }
#endif
#endif

#ifdef SEQ
  :: d_step { M.top < top -> M.top++ }
  :: d_step { M.role == acting && M.reserving == 0 && M.top < BLOCKS -> M.block = M.top + 1; M.reserving = 1;
#ifdef SEQ_BEFORE_ACK
       assert(!HAS(used, M.block)); ADD(used, M.block);
#endif
     }
  :: d_step { M.reserving == 1 && ACCEPTED(me) -> M.reserving = 2;
       if
       :: M.block > top -> top = M.block
       :: else
       fi }
#ifndef SEQ_BEFORE_ACK
  :: d_step { M.reserving == 2 -> M.reserving = 3; assert(!HAS(used, M.block)); ADD(used, M.block) }
#endif
#endif
  :: over -> break
  od
}

// One command at one member.
proctype work(bit me; byte c) {
  do
  // The journal arrives.
  :: d_step { HAS(late_ids[me], c) -> REMOVE(late_ids[me], c); REMOVE(M.ids_before, c); ADD(M.ids, c) }
  :: d_step { HAS(late_results[me], c) && !HAS(late_ids[me], c) ->
       REMOVE(late_results[me], c); REMOVE(M.results_before, c); ADD(M.results, c) }

  // The command arrives, perhaps for a second time.
  :: d_step { M.role == acting && session == me && HAS(commands, c) && !HAS(M.got, c) -> ADD(M.got, c);
#ifdef EARLY_PUBACK
       REMOVE(commands, c);
#endif
     }
#ifdef OBSERVE
  :: d_step { HAS(own_commands[me], c) -> REMOVE(own_commands[me], c); ADD(M.observed, c) }
  :: d_step { M.role == acting && HAS(M.observed, c) && !HAS(M.got, c) -> ADD(M.got, c) }
#endif

  :: d_step { M.role == acting && SEES(me) && M.at[c] == fresh && HAS(M.got, c) && !HAS(M.ids, c) ->
#ifdef NO_ANNOUNCEMENT
       M.at[c] = may_run
#else
       M.at[c] = announcing
#endif
     }
  :: d_step { M.role == acting && SEES(me) && M.at[c] == fresh && HAS(M.ids, c) && !HAS(M.results, c) ->
       M.at[c] = giving_up }
  // A repetition.
  :: d_step { M.role == acting && SEES(me) && (M.at[c] == closed || (M.at[c] == fresh && HAS(M.results, c))) &&
              session == me && HAS(commands, c) -> REMOVE(commands, c) }

  :: d_step { M.at[c] == announcing && ACCEPTED(me) ->
       M.at[c] = announced; ADD(late_ids[0], c); ADD(late_ids[1], c) }
#ifdef NO_PUBACK
  :: d_step { M.at[c] == announcing -> M.at[c] = may_run; ADD(M.ids, c);
       if
       :: session == me -> ADD(late_ids[OTHER(me)], c)
       :: else
       fi }
#endif
  :: d_step { M.role == acting && M.at[c] == announced -> M.at[c] = may_run; ADD(M.ids, c); acknowledge(c) }
  :: d_step { M.role == acting && M.at[c] == may_run && M.may_write ->
       runs[c]++; assert(runs[c] == 1); M.at[c] = ran }
  :: d_step { M.role == acting && M.at[c] == ran -> M.at[c] = reporting }
  :: d_step { M.at[c] == reporting && ACCEPTED(me) -> record(c, succeeded); M.at[c] = closed; acknowledge(c) }
  :: d_step { M.at[c] == giving_up && ACCEPTED(me) -> record(c, unknown_outcome); M.at[c] = closed; acknowledge(c) }
  :: over -> break
  od
}

proctype commander(byte c) {
  do
  :: d_step { left[c] > 0 -> left[c]--; ADD(commands, c); ADD(own_commands[0], c); ADD(own_commands[1], c) }
  :: over -> break
  od
}

proctype broker() {
  do
  :: d_step { crashes > 0 && !over -> crashes--; session = NOBODY;
#ifdef LOSE
       // It forgets what it has acknowledged.
       commands = 0; own_commands[0] = 0; own_commands[1] = 0;
       late_ids[0] = 0; late_ids[1] = 0; late_results[0] = 0; late_results[1] = 0;
       member[0].ids_before = 0; member[1].ids_before = 0; member[0].results_before = 0; member[1].results_before = 0;
       if
       :: member[0].blind == 0 -> member[0].blind = 1
       :: else
       fi;
       if
       :: member[1].blind == 0 -> member[1].blind = 1
       :: else
       fi;
#endif
     }
  :: over -> break
  od
}

// Everything is at rest, except for faults that did not happen.
proctype judge() {
  byte c;
  timeout -> over = true;
#ifndef ONLY_RUNS
  for (c : 0 .. NC - 1) { assert(outcome[c] != no_result || SENDS == 0 || !(SEES(0) && SEES(1))) }
#endif
#ifdef REACH
  assert(false)
#endif
}

init {
  byte c;
  atomic {
    run holder(0); run holder(1); run broker();
    for (c : 0 .. NC - 1) { run work(0, c); run work(1, c); run commander(c) }
    run judge()
  }
}
