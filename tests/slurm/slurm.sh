#!/bin/bash
# Two nodes of Slurm on the loopback interface, as root, without systemd, cgroups or a database; of Debian's
# packages `slurm-wlm` and `munge`. Ports from PORT on.
# usage: slurm.sh start|stop DIR PORT
#        slurm.sh kill|again DIR PORT slurmctld|slurmd.n1|slurmd.n2
set -eu
dir=$2 port=$3 host=$(hostname -s)
export SLURM_CONF=$dir/slurm.conf
case $1 in
start)
    mkdir -p "$dir"/{state,spool/n1,spool/n2,log,run,munge}
    chmod 700 "$dir/munge"
    dd if=/dev/urandom of="$dir/munge/munge.key" bs=1024 count=1 status=none
    chmod 400 "$dir/munge/munge.key"
    cat > "$SLURM_CONF" << END
ClusterName=test
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=$port
SlurmdPort=$((port + 1))
CommunicationParameters=NoInAddrAny,NoCtldInAddrAny
AuthType=auth/munge
AuthInfo=socket=$dir/run/munge.sock
CredType=cred/munge
SlurmUser=root
SlurmdUser=root
StateSaveLocation=$dir/state
SlurmdSpoolDir=$dir/spool/%n
SlurmctldPidFile=$dir/run/slurmctld.pid
SlurmdPidFile=$dir/run/slurmd.%n.pid
SlurmctldLogFile=$dir/log/slurmctld.log
SlurmdLogFile=$dir/log/slurmd.%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU_Memory
DefMemPerCPU=200
JobAcctGatherType=jobacct_gather/linux
JobAcctGatherFrequency=1
JobAcctGatherParams=OverMemoryKill
PreemptType=preempt/partition_prio
PreemptMode=CANCEL
SchedulerParameters=sched_interval=1,bf_interval=2,batch_sched_delay=0
AccountingStorageType=accounting_storage/none
MpiDefault=none
ReturnToService=2
SlurmctldTimeout=30
SlurmdTimeout=30
KillWait=2
MaxArraySize=1001
NodeName=n[1-2] NodeHostname=$host NodeAddr=127.0.0.1 Port=$((port + 2))-$((port + 3)) CPUs=2 RealMemory=2000
PartitionName=main Nodes=n[1-2] PriorityTier=1 Default=YES MaxTime=INFINITE State=UP
PartitionName=short Nodes=n[1-2] MaxTime=1 State=UP
PartitionName=urgent Nodes=n[1-2] PriorityTier=10 State=UP
END
    munged --force --key-file="$dir/munge/munge.key" --socket="$dir/run/munge.sock" \
        --pid-file="$dir/run/munged.pid" --log-file="$dir/log/munged.log" \
        --seed-file="$dir/munge/munged.seed" --num-threads=2
    slurmctld -c -f "$SLURM_CONF"
    for node in n1 n2; do slurmd -N $node -f "$SLURM_CONF"; done
    # A question to a controller that is not there takes 9 s.
    until=$((SECONDS + 20))
    while [ $SECONDS -lt $until ]; do
        [ "$(timeout 2 sinfo -h -t idle -o %D 2> /dev/null || true)" = 2 ] && exit 0
        sleep 0.05
    done
    echo "the nodes are not idle after 20 s; its daemons said:" >&2
    tail -n 5 "$dir"/log/*.log >&2
    exit 1
    ;;
kill)
    kill -9 "$(cat "$dir/run/$4.pid")"
    ;;
again)
    # With the jobs that it knew.
    case $4 in
    slurmctld) slurmctld -f "$SLURM_CONF" ;;
    slurmd.*) slurmd -N "${4#slurmd.}" -f "$SLURM_CONF" ;;
    esac
    ;;
stop)
    for daemon in slurmd.n1 slurmd.n2 slurmctld munged; do
        pid=$(cat "$dir/run/$daemon.pid" 2> /dev/null) || continue
        kill -9 "$pid" 2> /dev/null || true
    done
    ;;
esac
